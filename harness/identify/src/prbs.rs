//! Pseudo-random binary sequences: inputs that keep changing, and are the same for everybody.

/// So many bits of a maximal sequence of 1023, from a shift register of ten with taps 10 and 7. Seeds that are the same
/// modulo 1023 give the same.
pub fn bits(seed: u64, count: usize) -> Vec<bool> {
    let mut register = 1 + (seed % 1_023) as u16;
    let next = |_| {
        let bit = ((register >> 9) ^ (register >> 6)) & 1;
        register = ((register << 1) | bit) & 0x3ff;
        bit == 1
    };
    (0..count).map(next).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sequence_is_maximal_and_nearly_balanced() {
        let sequence = bits(7, 2 * 1_023);
        assert_eq!(sequence[..1_023], sequence[1_023..]);
        assert_eq!(sequence[..1_023].iter().filter(|bit| **bit).count(), 512);
        assert!((1..1_023).all(|shift| sequence[..1_023] != sequence[shift..shift + 1_023]));
    }
}
