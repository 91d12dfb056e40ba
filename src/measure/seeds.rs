//! Seeds of random numbers: by what is made of them, never by the order in which it is made.

use crate::base::files;
use serde_json::Value as Json;

/// The seed of the first of several pictures that depend on `inputs`; those of the others count on from it.
///
/// It is in 2^30 to 2^31 - 1. So it has no neighbours among the small seeds that people give and that sides of a comparison have (ours from 100 on,
/// Cycles' from 5000 on), and counting on does not wrap. The build is no part of it: one that changed nothing about a picture makes the
/// same one. Ranges of two inputs that are n seeds long share one with a probability of 2n / 2^30.
pub fn first(inputs: &Json) -> u32 {
    let hash = files::sha256(inputs.to_string().as_bytes());
    let bits = u32::from_str_radix(&hash[..8], 16).expect("a hash has hexadecimal digits");
    // Half a billion values at the top are left free for counting on.
    (1 << 30) + bits % (1 << 29)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn seeds_depend_on_what_they_are_for_alone() {
        let inputs = |scene: u32, purpose: &str| json!({"scene": scene, "purpose": purpose});
        let seed = first(&inputs(1, "truth"));
        assert_eq!(seed, first(&inputs(1, "truth")));
        let others: Vec<u32> = (0..1000).map(|scene| first(&inputs(scene, "verification"))).collect();
        assert!(others.iter().all(|&other| other.abs_diff(seed) > 64), "ranges of 64 replicas stay apart");
        assert!(others.iter().all(|seed| (1 << 30..1 << 31).contains(seed)));
    }
}
