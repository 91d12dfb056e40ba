//! F1 distance on SIMD lanes; the same bits as the full scan.

use super::VoronoiTexture;
use crate::nodes::Column;

/// Evaluates if this mode and these inputs have a lane version.
pub(super) fn evaluate(_node: &VoronoiTexture, _inputs: &[Column<'_, f32>], _outputs: &mut [&mut [f32]]) -> bool {
    false
}
