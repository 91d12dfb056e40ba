//! What the SIMD versions of nodes share, one point per lane: reading and writing columns, comparisons that keep the operand
//! order of the kernels, and Jenkins' hash.

use fearless_simd::prelude::*;

/// No vector has more lanes.
pub(super) const MOST: usize = 64;

/// The values of up to a vector's width of points; 0 in the lanes that are left.
#[inline(always)]
pub(super) fn load<S: Simd>(simd: S, values: &[f32]) -> S::f32s {
    if values.len() == S::f32s::LEN {
        return S::f32s::from_slice(simd, values);
    }
    let mut padded = [0.0; MOST];
    padded[..values.len()].copy_from_slice(values);
    S::f32s::from_slice(simd, &padded[..S::f32s::LEN])
}

/// Writes the first lanes to as many points.
#[inline(always)]
pub(super) fn store<S: Simd>(value: S::f32s, values: &mut [f32]) {
    if values.len() == S::f32s::LEN {
        value.store_slice(values);
        return;
    }
    let mut padded = [0.0; MOST];
    value.store_slice(&mut padded[..S::f32s::LEN]);
    values.copy_from_slice(&padded[..values.len()]);
}

/// Those of the first `used` lanes in which the mask is set, or not set.
#[inline(always)]
pub(super) fn marked<S: Simd>(mask: S::mask32s, is_set: bool, used: usize) -> impl Iterator<Item = usize> {
    let bits = mask.to_bitmask();
    (0..used).filter(move |lane| (bits >> lane & 1 != 0) == is_set)
}

/// [`crate::nodes::Real::lesser`].
#[inline(always)]
pub(super) fn lesser<S: Simd>(a: S::f32s, b: S::f32s) -> S::f32s {
    a.simd_lt(b).select(a, b)
}

/// [`crate::nodes::Real::greater`].
#[inline(always)]
pub(super) fn greater<S: Simd>(a: S::f32s, b: S::f32s) -> S::f32s {
    a.simd_gt(b).select(a, b)
}

/// [`crate::nodes::Real::saturate`]: NaN becomes 0.
#[inline(always)]
pub(super) fn saturate<S: Simd>(simd: S, value: S::f32s) -> S::f32s {
    lesser::<S>(greater::<S>(value, S::f32s::splat(simd, 0.0)), S::f32s::splat(simd, 1.0))
}

/// [`crate::nodes::hash::jenkins`].
#[inline(always)]
pub(super) fn jenkins<S: Simd, const N: usize>(simd: S, keys: [S::u32s; N]) -> S::u32s {
    let mut words = mixed_words::<S, N>(simd, keys);
    if N == 4 {
        words[0] += keys[3];
    }
    finished_hash::<S>(words)
}

/// Value of a hash in [0, 1], as [`crate::nodes::Real::from_hash_32`].
#[inline(always)]
pub(super) fn hash_value<S: Simd>(hash: S::u32s) -> S::f32s {
    S::f32s::float_from(hash) * (1.0 / 4_294_967_296.0)
}

/// The words of Jenkins' hash before its last round, without the fourth key.
#[inline(always)]
pub(super) fn mixed_words<S: Simd, const N: usize>(simd: S, keys: [S::u32s; N]) -> [S::u32s; 3] {
    let start = 0xDEAD_BEEF_u32.wrapping_add(4 * N as u32).wrapping_add(13);
    let [mut a, mut b, mut c] = [S::u32s::splat(simd, start); 3];
    a += keys[0];
    if N >= 2 {
        b += keys[1];
    }
    if N >= 3 {
        c += keys[2];
    }
    if N == 4 {
        (a, c) = mix::<S>(a, b, c, 4);
        (b, a) = mix::<S>(b, c, a, 6);
        (c, b) = mix::<S>(c, a, b, 8);
        (a, c) = mix::<S>(a, b, c, 16);
        (b, a) = mix::<S>(b, c, a, 19);
        (c, b) = mix::<S>(c, a, b, 4);
    }
    [a, b, c]
}

/// The last round of Jenkins' hash.
#[inline(always)]
pub(super) fn finished_hash<S: Simd>([mut a, mut b, mut c]: [S::u32s; 3]) -> S::u32s {
    c = last::<S>(c, b, 14);
    a = last::<S>(a, c, 11);
    b = last::<S>(b, a, 25);
    c = last::<S>(c, b, 16);
    a = last::<S>(a, c, 4);
    b = last::<S>(b, a, 14);
    last::<S>(c, b, 24)
}

#[inline(always)]
fn rotate<S: Simd>(value: S::u32s, count: u32) -> S::u32s {
    (value << count) | (value >> (32 - count))
}

/// One mixing step on (x, y, z): the new x and z.
#[inline(always)]
fn mix<S: Simd>(x: S::u32s, y: S::u32s, z: S::u32s, count: u32) -> (S::u32s, S::u32s) {
    ((x - z) ^ rotate::<S>(z, count), z + y)
}

/// One final step: the new x.
#[inline(always)]
fn last<S: Simd>(x: S::u32s, y: S::u32s, count: u32) -> S::u32s {
    (x ^ y) - rotate::<S>(y, count)
}
