//! Gradient noise in one to four dimensions (Perlin, "Improving Noise", 2002, with Jenkins' hash
//! in place of the permutation), scaled to about [-1, 1]. Arithmetic order is that of Cycles'
//! SSE4.2 kernel.

use crate::base::arrays::{Mapped, each};
use crate::nodes::hash::{hash_floats, jenkins};
use crate::nodes::real::Real;

/// Factor that brings the noise of 1 to 4 dimensions to about [-1, 1].
pub const SCALE: [f32; 4] = [0.25, 0.6616, 0.982, 0.8344];

/// Coordinates repeat after this many cells.
pub const PERIOD: f32 = 100_000.0;

/// Signed noise at `p`; finite for finite coordinates, NaN otherwise.
#[inline]
pub fn signed_noise<R: Real, const N: usize>(p: [R; N]) -> R {
    R::of(SCALE[N - 1]) * perlin(p.mapped(wrap::<R, N>))
}

/// Wraps one coordinate; from 1e6 on, where f32 is coarse, half a cell is added.
#[inline(always)]
fn wrap<R: Real, const N: usize>(p: R) -> R {
    let shift = if p.abs() >= R::of(1_000_000.0) { R::of(0.5) } else { R::of(0.0) };
    let wrapped = if N <= 2 { p.fmod(R::of(PERIOD)) } else { p - (p * R::of(1.0 / PERIOD)).trunc() * R::of(PERIOD) };
    (wrapped + shift).round_coordinate()
}

#[inline(always)]
fn negate_if<R: Real>(value: R, condition: bool) -> R {
    if condition { -value } else { value }
}

/// Gradient dot offset at a corner with hash `h`.
#[inline(always)]
pub(super) fn gradient<R: Real, const N: usize>(h: u32, d: [R; N]) -> R {
    match N {
        1 => {
            let h = h & 15;
            let magnitude = R::of((1 + (h & 7)) as f32);
            negate_if(magnitude, h & 8 != 0) * d[0]
        }
        2 => {
            let h = h & 7;
            let (u, v) = if h < 4 { (d[0], d[1]) } else { (d[1], d[0]) };
            negate_if(u, h & 1 != 0) + negate_if(R::of(2.0) * v, h & 2 != 0)
        }
        3 => {
            let h = h & 15;
            let u = if h < 8 { d[0] } else { d[1] };
            let v = if h < 4 {
                d[1]
            } else if h == 12 || h == 14 {
                d[0]
            } else {
                d[2]
            };
            negate_if(u, h & 1 != 0) + negate_if(v, h & 2 != 0)
        }
        _ => {
            let h = h & 31;
            let u = if h < 24 { d[0] } else { d[1] };
            let v = if h < 16 { d[1] } else { d[2] };
            let s = if h < 8 { d[2] } else { d[3] };
            (negate_if(u, h & 1 != 0) + negate_if(v, h & 2 != 0)) + negate_if(s, h & 4 != 0)
        }
    }
}

fn perlin<R: Real, const N: usize>(p: [R; N]) -> R {
    let floors = p.mapped(Real::lattice_floor);
    let cell = floors.mapped(|x| x.to_int() as u32);
    let fraction: [R; N] = each(|axis| p[axis] - floors[axis]);
    let weight = fraction
        .map(|f| if N == 1 { f.quintic() } else { (f * f) * (f * (f * (f * R::of(6.0) - R::of(15.0)) + R::of(10.0))) });
    let mut corners = [R::of(0.0); 16];
    for (index, corner) in corners.iter_mut().enumerate().take(1 << N) {
        let bit = |axis: usize| (index >> axis) & 1;
        let hash = jenkins(each::<u32, N>(|axis| cell[axis].wrapping_add(bit(axis) as u32)));
        let offset: [R; N] = each(|axis| fraction[axis] - R::of(bit(axis) as f32));
        *corner = gradient(hash, offset);
    }
    let mut count = 1 << N;
    for t in weight {
        count /= 2;
        for index in 0..count {
            corners[index] = corners[2 * index].lerp(corners[2 * index + 1], t);
        }
    }
    corners[0]
}

/// Offset vector in [100, 200] number `seed`, which decorrelates outputs and distortion.
pub fn random_offset<R: Real, const N: usize>(seed: f32) -> [R; N] {
    each(|axis| {
        let hash: R = if N == 1 { hash_floats([R::of(seed)]) } else { hash_floats([R::of(seed), R::of(axis as f32)]) };
        (R::of(100.0) + hash * R::of(100.0)).round_coordinate()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_have_the_published_values() {
        assert_eq!(random_offset::<f32, 1>(0.0), [158.242_58]);
        assert_eq!(random_offset::<f32, 4>(0.0), [186.031_28, 114.955_956, 154.447_51, 142.504_91]);
        assert_eq!(random_offset::<f32, 3>(5.0)[2], 162.052_16);
    }

    #[test]
    fn lattice_points_give_zero() {
        assert_eq!(signed_noise([3.0_f32, -2.0, 7.0]), 0.0);
    }
}
