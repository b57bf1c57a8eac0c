//! What a program at a port does not read.

/// Bytes that are lost because a client does not read. That is told whenever they are twice as many as when it was last
/// told: one that never reads does not fill the log.
#[derive(Debug, Default)]
pub(super) struct Unread {
    lost: usize,
    told: usize,
}

impl Unread {
    /// Counts `lost` more. Says how many there are, if that is to be told.
    pub(super) fn add(&mut self, lost: usize) -> Option<usize> {
        self.lost += lost;
        let is_due = lost > 0 && self.lost >= 2 * self.told;
        is_due.then(|| {
            self.told = self.lost;
            self.lost
        })
    }

    /// Another client has the port.
    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_told_at_once_and_then_as_often_as_the_loss_has_doubled() {
        let mut unread = Unread::default();
        assert_eq!(unread.add(0), None);
        let told: Vec<usize> = (0..1000).filter_map(|_| unread.add(3)).collect();
        assert_eq!(told, [3, 6, 12, 24, 48, 96, 192, 384, 768, 1536]);
        unread.forget();
        assert_eq!(unread.add(1), Some(1));
    }
}
