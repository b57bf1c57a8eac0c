//! The largest value of a line and a staircase together, and where it first reaches a threshold: how a check that
//! corrects is found without running those before it.

/// The function `add·i + step·⌊(slope·i + offset)/run⌋` of whole numbers i ≥ 0.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Staircase {
    pub(crate) add: i128,
    pub(crate) step: i128,
    pub(crate) slope: i128,
    pub(crate) offset: i128,
    /// Above zero.
    pub(crate) run: i128,
}

impl Staircase {
    #[cfg(test)]
    fn at(&self, i: i128) -> i128 {
        self.add * i + self.step * (self.slope * i + self.offset).div_euclid(self.run)
    }

    /// Its largest value for i below `n`, which is at least one.
    ///
    /// As in Euclid's algorithm: slope and offset are reduced below the run; if line and steps then pull in different
    /// senses, the largest value lies at the side of a step, and the steps are counted instead.
    fn largest(&self, n: i128) -> i128 {
        let Self { mut add, mut step, mut slope, mut offset, mut run } = *self;
        let (mut n, mut base, mut best) = (n, 0, i128::MIN);
        loop {
            add += step * slope.div_euclid(run);
            slope = slope.rem_euclid(run);
            base += step * offset.div_euclid(run);
            offset = offset.rem_euclid(run);
            let steps = (slope * (n - 1) + offset) / run;
            best = best.max(base).max(base + add * (n - 1) + step * steps);
            if steps == 0 || (add >= 0) == (step >= 0) {
                return best;
            }
            if add < 0 {
                base += add + step;
            }
            (n, add, step, offset) = (steps, step, add, run - offset - 1);
            (slope, run) = (run, slope);
        }
    }

    /// The first i below `n` at which it is at least `threshold`.
    pub(crate) fn first(&self, threshold: i128, n: i128) -> Option<i128> {
        if n <= 0 || self.largest(n) < threshold {
            return None;
        }
        // It is reached at one below `some`, and at none below `none`.
        let (mut none, mut some) = (0, 1);
        while self.largest(some.min(n)) < threshold {
            (none, some) = (some, 2 * some);
        }
        some = some.min(n);
        while some - none > 1 {
            let middle = none + (some - none) / 2;
            if self.largest(middle) < threshold {
                none = middle;
            } else {
                some = middle;
            }
        }
        Some(some - 1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, cases: 5_000, ..ProptestConfig::default() })]

        #[test]
        fn finds_what_trying_each_finds(
            (add, step, slope) in (-40_i128..=40, -60_i128..=60, -70_i128..=70),
            (offset, run, n) in (-99_i128..=99, 1_i128..=40, 1_i128..=90),
            threshold in -900_i128..=900,
        ) {
            let staircase = Staircase { add, step, slope, offset, run };
            prop_assert_eq!(Some(staircase.largest(n)), (0..n).map(|i| staircase.at(i)).max());
            prop_assert_eq!(staircase.first(threshold, n), (0..n).find(|i| staircase.at(*i) >= threshold));
        }
    }
}
