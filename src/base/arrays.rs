//! Arrays whose entries are made one by one: for what runs at every point or is compiled for several number types. Elsewhere the library's
//! `from_fn` and `map` do.

/// `[value(0), ..., value(N - 1)]`. Unlike the library's it is inlined whatever its size: as a function of its own it would be
/// compiled without the instructions of the lanes, and be a call between parts of the crate that are compiled apart. It is a
/// tenth of the code, too, for every closure and number type that it meets.
#[inline(always)]
pub fn each<T: Copy, const N: usize>(mut value: impl FnMut(usize) -> T) -> [T; N] {
    let mut values = [value(0); N];
    let mut index = 1;
    while index < N {
        values[index] = value(index);
        index += 1;
    }
    values
}

/// The library's `map` by [`each`].
pub trait Mapped<T, const N: usize> {
    /// `[function(self[0]), ..., function(self[N - 1])]`.
    fn mapped<R: Copy>(self, function: impl FnMut(T) -> R) -> [R; N];
}

impl<T: Copy, const N: usize> Mapped<T, N> for [T; N] {
    #[inline(always)]
    fn mapped<R: Copy>(self, mut function: impl FnMut(T) -> R) -> [R; N] {
        each(|index| function(self[index]))
    }
}
