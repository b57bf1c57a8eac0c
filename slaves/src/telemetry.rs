//! What telemetry has told of a board's quantities.

/// The values of `S` quantities, and those told last.
#[derive(Clone, Debug)]
pub(crate) struct Telemetry<const S: usize> {
    values: [i64; S],
    told: [i64; S],
    /// Of those before this one, the values have been told.
    next: usize,
}

impl<const S: usize> Telemetry<S> {
    /// The values at power-on need not be told: the board's description says them.
    pub(crate) const fn new(initial: [i64; S]) -> Self {
        Self { values: initial, told: initial, next: S }
    }

    /// The values from now on.
    pub(crate) const fn note(&mut self, values: [i64; S]) {
        self.values = values;
        self.next = 0;
    }

    /// A quantity that has changed: its place among the signals, and its value.
    pub(crate) fn poll(&mut self) -> Option<(u8, i64)> {
        while self.next < S {
            let place = self.next;
            let value = self.values[place];
            self.next += 1;
            if core::mem::replace(&mut self.told[place], value) != value {
                return Some((u8::try_from(place).ok()?, value));
            }
        }
        None
    }
}
