//! The frame of a published slab in a container: its metres, its up axis, its lengths.

use crate::base::error::Result;
use crate::engines::Request;
use crate::engines::domain::{Container, Domain};
use crate::engines::march::air::Air;
use crate::engines::node_graph::{Input, NodeGraph};

/// A published slab, placed in a container: the container's lower face is the slab's base, its upper face the slab's top, and its sides
/// are cut out of the slab with the same scale, around the slab's origin. The published y axis points up, which is our z; its z is our -y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlabFrame {
    /// Published metres per unit of the container's frame, by our axes.
    pub scale: [f64; 3],
    /// The middle of the container, at its lower face, in its frame.
    pub origin: [f64; 3],
    /// Height of the container in its frame.
    pub height: f64,
    /// Published height of the base in metres.
    pub base: f64,
    /// Published metres in the engine's unit of length.
    pub unit: f64,
}

impl SlabFrame {
    /// The container of a request, an object's where none was asked for, and the slab in it whose base is the parameter `base`, whose height is
    /// `thickness`.
    pub fn of(request: &Request<'_>, base: &str) -> Result<(Container, Self)> {
        let container = request.domain_or(Domain::Object)?;
        let base = request.values.get(base);
        let frame = Self::new(&container, base, base + request.values.get("thickness"));
        Ok((container, frame))
    }

    /// Places a slab from `base` to `top`, in metres.
    pub fn new(container: &Container, base: f64, top: f64) -> Self {
        let region = container.outline.region();
        let to_world = container.to_local.inverse();
        let lengths = [to_world.x_axis, to_world.y_axis, to_world.z_axis].map(|axis| axis.truncate().length());
        let height = region.high.z - region.low.z;
        let per_metre = (top - base) / (height * lengths[2]);
        let middle = (region.low + region.high) / 2.0;
        Self {
            scale: lengths.map(|length| per_metre * length),
            origin: [middle.x, middle.y, region.low.z],
            height,
            base,
            unit: per_metre * container.unit,
        }
    }

    /// Air over this slab, without any of it yet.
    pub fn air(&self) -> Air {
        let slope = self.scale[2];
        Air::none(self.unit, [slope, self.base - self.origin[2] * slope], self.base + self.height * slope)
    }

    /// The published place in metres, and its height as a part of the slab's.
    pub fn place(&self, graph: &mut NodeGraph) -> (Input, Input) {
        let own = graph.place();
        let [sx, sy, sz] = self.scale;
        let [ox, oy, oz] = self.origin;
        let scaled = graph.affine(&own, [sx, sy, sz], [-ox * sx, -oy * sy, self.base - oz * sz]);
        let [x, y, up] = graph.separate(&scaled);
        let away = graph.multiply(y, -1.0);
        let [_, _, z] = graph.separate(&own);
        // From the container's own faces: exact at both.
        let part = graph.remap(&z, [oz.into(), (oz + self.height).into()], [0.0, 1.0], false);
        (graph.combine([x, up, away]), part)
    }
}
