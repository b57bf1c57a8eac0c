//! What telemetry has told of a board's quantities.

/// The values told last, of `S` quantities.
#[derive(Clone, Debug)]
pub(crate) struct Telemetry<const S: usize> {
    told: [i64; S],
}

impl<const S: usize> Telemetry<S> {
    /// The values at power-on need not be told: the board's description says them.
    pub(crate) const fn new(initial: [i64; S]) -> Self {
        Self { told: initial }
    }

    /// A quantity that has changed: its place among the signals, and its value.
    pub(crate) fn poll(&mut self, values: [i64; S]) -> Option<(u8, i64)> {
        let changed = values.iter().zip(&self.told).position(|(value, told)| value != told)?;
        self.told[changed] = values[changed];
        Some((u8::try_from(changed).ok()?, values[changed]))
    }
}
