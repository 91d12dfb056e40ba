//! Steps between two values.

/// Cubic Hermite step from 0 below `low` to 1 above `high`.
pub fn smooth<T: num_traits::Float>(low: T, high: T, value: T) -> T {
    let three = T::one() + T::one() + T::one();
    let t = ((value - low) / (high - low)).max(T::zero()).min(T::one());
    t * t * (three - (t + t))
}
