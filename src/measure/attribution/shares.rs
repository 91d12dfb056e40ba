//! Shapley values: what each stage has of a difference, whatever the order in which stages are replaced.
//!
//! With the value v of a set of replaced stages, stage i has the mean over orders of v(those before it) - v(those and i). So the shares of all
//! add up to v(none) - v(all), in every order (Shapley 1953, "A Value for n-Person Games").

use crate::measure::attribution::stage::{Stage, Stages};
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;

/// Orders of replacement.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Orders {
    /// All of them.
    All,
    /// Some, drawn in pairs: an order and the same from its end.
    Drawn(Vec<Vec<Stage>>),
}

/// A set's weight in the share of a stage.
struct Term {
    before: Stages,
    weight: f64,
}

impl Orders {
    /// At most so many orders where all of them would ask for more sets than these do.
    pub fn of(stages: &[Stage], most: u32, seed: u64) -> Self {
        let pairs = most.div_ceil(2);
        let sets_of_drawn = 2.0 + 2.0 * f64::from(pairs) * (stages.len() as f64 - 1.0).max(0.0);
        if (stages.len() as f64).exp2() <= sets_of_drawn {
            return Self::All;
        }
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut orders = Vec::new();
        for _ in 0..pairs {
            let mut order = stages.to_vec();
            order.shuffle(&mut random);
            orders.push(order.clone());
            order.reverse();
            orders.push(order);
        }
        Self::Drawn(orders)
    }

    /// Every set whose value is asked for: the smaller first.
    pub fn sets(&self, stages: &[Stage]) -> Vec<Stages> {
        let mut sets: Vec<Stages> = match self {
            Self::All => (0..1_u32 << stages.len())
                .map(|bits| (0..stages.len()).filter(|bit| bits >> bit & 1 == 1).map(|bit| stages[bit]).collect())
                .collect(),
            Self::Drawn(orders) => {
                let upto = |order: &Vec<Stage>, count: usize| order[..count].iter().copied().collect::<Stages>();
                orders.iter().flat_map(|order| (0..=order.len()).map(move |count| upto(order, count))).collect()
            }
        };
        sets.sort_by_key(|set| (set.len(), set.clone()));
        sets.dedup();
        sets
    }

    fn terms(&self, stages: &[Stage], stage: Stage) -> Vec<Term> {
        match self {
            Self::All => {
                let others: Vec<Stage> = stages.iter().copied().filter(|other| *other != stage).collect();
                let term = |before: Stages| {
                    // |S|! (n - 1 - |S|)! / n!, without factorials: 1 / (n binomial(n - 1, |S|)).
                    let (mut binomial, count) = (1.0, others.len());
                    for picked in 0..before.len() {
                        binomial *= (count - picked) as f64 / (picked + 1) as f64;
                    }
                    Term { weight: 1.0 / (stages.len() as f64 * binomial), before }
                };
                Self::All.sets(&others).into_iter().map(term).collect()
            }
            Self::Drawn(orders) => {
                let weight = 1.0 / orders.len() as f64;
                let before = |order: &Vec<Stage>| order.iter().copied().take_while(|other| *other != stage).collect();
                orders.iter().map(|order| Term { before: before(order), weight }).collect()
            }
        }
    }

    /// Adds up a stage's share: `add` gets a weight, the set before the stage was replaced, and the set after.
    pub fn share(&self, stages: &[Stage], stage: Stage, mut add: impl FnMut(f64, &Stages, &Stages)) {
        for Term { before, weight } in self.terms(stages, stage) {
            let mut after = before.clone();
            after.insert(stage);
            add(weight, &before, &after);
        }
    }

    /// The standard error of a stage's share by a value, from what pairs of orders differ; 0 where all orders count.
    pub fn standard_error(&self, stages: &[Stage], stage: Stage, value: impl Fn(&Stages) -> f64) -> f64 {
        let Self::Drawn(orders) = self else { return 0.0 };
        let mut changes = Vec::new();
        self.share(stages, stage, |_, before, after| changes.push(value(before) - value(after)));
        let pairs: Vec<f64> = changes.chunks_exact(2).map(|pair| (pair[0] + pair[1]) / 2.0).collect();
        let count = pairs.len() as f64;
        debug_assert_eq!(2 * pairs.len(), orders.len());
        let mean = pairs.iter().sum::<f64>() / count;
        let spread: f64 = pairs.iter().map(|pair| (pair - mean).powi(2)).sum();
        // Of one pair there is none.
        if pairs.len() < 2 { f64::INFINITY } else { (spread / (count * (count - 1.0))).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values with interactions: a sum, a product of two, and one stage that does nothing.
    fn value(set: &Stages) -> f64 {
        let gone = |stage: Stage| f64::from(u8::from(!set.contains(&stage)));
        4.0 * gone(Stage::Field) + 2.0 * gone(Stage::Shadow) * gone(Stage::Phase) + gone(Stage::Orders).powi(2)
            - 3.0 * gone(Stage::Orders) * gone(Stage::Shadow) * gone(Stage::Field)
    }

    fn share(orders: &Orders, stages: &[Stage], stage: Stage) -> f64 {
        let mut sum = 0.0;
        orders.share(stages, stage, |weight, before, after| sum += weight * (value(before) - value(after)));
        sum
    }

    #[test]
    fn shares_are_those_of_the_closed_form() {
        let stages = [Stage::Field, Stage::Shadow, Stage::Phase, Stage::Orders, Stage::Ambient];
        let found: Vec<f64> = stages.iter().map(|&stage| share(&Orders::All, &stages, stage)).collect();
        // A product of n stages that are there together is shared in n equal parts.
        let wanted = [4.0 - 1.0, 1.0 - 1.0, 1.0, 1.0 - 1.0, 0.0];
        for (found, wanted) in found.iter().zip(wanted) {
            assert!((found - wanted).abs() < 1e-14, "{found} {wanted}");
        }
        assert_eq!(Orders::All.sets(&stages).len(), 32);
    }

    #[test]
    fn drawn_orders_add_up_and_come_near() {
        let stages = Stage::ALL;
        let whole = value(&Stages::new()) - value(&stages.iter().copied().collect());
        for seed in 0..5 {
            let orders = Orders::of(stages, 32, seed);
            assert!(matches!(&orders, Orders::Drawn(orders) if orders.len() == 32));
            let mut sum = 0.0;
            for &stage in stages {
                let found = share(&orders, stages, stage);
                let error = orders.standard_error(stages, stage, value);
                let wanted = share(&Orders::All, stages, stage);
                // 6 standard errors with 15 degrees of freedom have a probability of 0.002 %; these are 45.
                assert!((found - wanted).abs() <= 6.0 * error + 1e-12, "{stage:?} {found} {wanted} {error}");
                sum += found;
            }
            assert!((sum - whole).abs() < 1e-12);
        }
        assert_eq!(Orders::of(&Stage::ALL[..5], 12, 1), Orders::All);
    }
}
