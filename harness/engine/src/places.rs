//! A set of places: numbers of boards or lines.

/// A set of small numbers that is gone through in order, and may change meanwhile.
#[derive(Debug, Default)]
pub(super) struct Places {
    /// A bit each.
    words: Vec<u64>,
}

impl Places {
    /// Adds one. Says whether it was not there.
    pub(super) fn insert(&mut self, place: usize) -> bool {
        let (word, bit) = (place / 64, 1 << (place % 64));
        if word >= self.words.len() {
            self.words.resize(word + 1, 0);
        }
        let new = self.words[word] & bit == 0;
        self.words[word] |= bit;
        new
    }

    /// Takes all out.
    pub(super) fn clear(&mut self) {
        self.words.fill(0);
    }

    /// Takes one out.
    pub(super) fn remove(&mut self, place: usize) {
        if let Some(word) = self.words.get_mut(place / 64) {
            *word &= !(1 << (place % 64));
        }
    }

    /// The first from `place` on.
    pub(super) fn first_from(&self, place: usize) -> Option<usize> {
        let word = place / 64;
        let first = self.words.get(word)? & (u64::MAX << (place % 64));
        let rest = self.words[word + 1..].iter().copied();
        let mut words = (word..).zip(core::iter::once(first).chain(rest));
        words.find(|(_, bits)| *bits != 0).map(|(word, bits)| 64 * word + bits.trailing_zeros() as usize)
    }

    /// All of them, in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = usize> {
        core::iter::successors(self.first_from(0), |place| self.first_from(place + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_gone_through_in_order() {
        let mut places = Places::default();
        assert_eq!(places.first_from(7), None);
        let all = [130, 3, 64, 63, 3, 0].map(|place| places.insert(place));
        assert_eq!(all, [true, true, true, true, false, true]);
        assert_eq!(places.iter().collect::<Vec<_>>(), [0, 3, 63, 64, 130]);
        [0, 64, 99, 999].into_iter().for_each(|place| places.remove(place));
        assert_eq!(
            [0, 4, 64, 131, 999].map(|from| places.first_from(from)),
            [Some(3), Some(63), Some(130), None, None]
        );
        places.clear();
        assert_eq!(places.first_from(0), None);
    }
}
