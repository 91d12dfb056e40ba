//! Integer hashes of the texture nodes: Jenkins' lookup3 for gradient noise and 1D Voronoi, the
//! signed PCG of Jarzynski and Olano ("Hash Functions for GPU Rendering", JCGT 9(3), 2020) in
//! Blender's variant for 2D to 4D Voronoi. All arithmetic wraps modulo 2^32.

use crate::base::arrays::Mapped;
use crate::nodes::real::Real;

/// Jenkins' lookup3 of one to four words.
#[inline(always)]
pub fn jenkins<const N: usize>(keys: [u32; N]) -> u32 {
    let start = 0xDEAD_BEEF_u32.wrapping_add(4 * N as u32).wrapping_add(13);
    let [mut a, mut b, mut c] = [start; 3];
    a = a.wrapping_add(keys[0]);
    if N >= 2 {
        b = b.wrapping_add(keys[1]);
    }
    if N >= 3 {
        c = c.wrapping_add(keys[2]);
    }
    if N == 4 {
        let mix = |x: &mut u32, y: &mut u32, z: &mut u32, rotation: u32| {
            *x = x.wrapping_sub(*z) ^ z.rotate_left(rotation);
            *z = z.wrapping_add(*y);
        };
        mix(&mut a, &mut b, &mut c, 4);
        mix(&mut b, &mut c, &mut a, 6);
        mix(&mut c, &mut a, &mut b, 8);
        mix(&mut a, &mut b, &mut c, 16);
        mix(&mut b, &mut c, &mut a, 19);
        mix(&mut c, &mut a, &mut b, 4);
        a = a.wrapping_add(keys[3]);
    }
    let last = |x: &mut u32, y: u32, rotation: u32| *x = (*x ^ y).wrapping_sub(y.rotate_left(rotation));
    last(&mut c, b, 14);
    last(&mut a, c, 11);
    last(&mut b, a, 25);
    last(&mut c, b, 16);
    last(&mut a, c, 4);
    last(&mut b, a, 14);
    last(&mut c, b, 24);
    c
}

/// Value in [0, 1] of the hash of float bit patterns.
#[inline]
pub fn hash_floats<R: Real, const N: usize>(values: [R; N]) -> R {
    R::from_hash_32(jenkins(values.mapped(|value| value.to_f32().to_bits())))
}

const MULTIPLIER: i32 = 1_664_525;
const INCREMENT: i32 = 1_013_904_223;

/// Signed PCG of two to four words, masked to 31 bits.
#[inline(always)]
pub fn pcg<const N: usize>(cell: [i32; N]) -> [i32; N] {
    let mut v = cell.mapped(|x| x.wrapping_mul(MULTIPLIER).wrapping_add(INCREMENT));
    let round = |v: &mut [i32; N]| match N {
        2 => {
            v[0] = v[0].wrapping_add(v[1].wrapping_mul(MULTIPLIER));
            v[1] = v[1].wrapping_add(v[0].wrapping_mul(MULTIPLIER));
        }
        3 => {
            v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
            v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
            v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        }
        _ => {
            v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
            v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
            v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
            v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
        }
    };
    round(&mut v);
    v = v.mapped(|x| x ^ (x >> 16));
    round(&mut v);
    v.mapped(|x| x & 0x7FFF_FFFF)
}

/// [`pcg`] as values in [0, 1].
#[inline(always)]
pub fn pcg_values<R: Real, const N: usize>(cell: [i32; N]) -> [R; N] {
    pcg(cell).mapped(R::from_hash_31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jenkins_gives_the_published_values() {
        assert_eq!(jenkins([0]), 0x9519_DC65);
        assert_eq!(jenkins([1]), 0x4AD7_C6A0);
        assert_eq!(jenkins([1, 2]), 0x1037_CB9D);
        assert_eq!(jenkins([1, 2, 3]), 0xB8D1_7A0A);
        assert_eq!(jenkins([1, 2, 3, 4]), 0x0584_DEC1);
    }

    #[test]
    fn pcg_gives_the_published_values() {
        assert_eq!(pcg([1, -2]), [0x49EB_F9CB, 0x2115_895D]);
        assert_eq!(pcg([1, -2, 3]), [0x362E_14A4, 0x1B4C_0AC6, 0x2F3B_79E1]);
        assert_eq!(pcg([1, -2, 3, -4]), [0x6924_4556, 0x5EB1_F6E2, 0x54CC_87A7, 0x6603_83A3]);
    }
}
