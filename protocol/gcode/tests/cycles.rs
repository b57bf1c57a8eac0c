//! Contours at random, through every cycle that has one: no panic, no endless loop, no place that is no number.

use torno_gcode::{Dialect, Kind, Motion, Settings, interpret};

/// The same numbers on each machine.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % most
    }

    /// In tenths.
    fn length(&mut self, most: u64) -> f64 {
        self.below(most * 10) as f64 / 10.0
    }
}

fn contour(numbers: &mut Numbers) -> Vec<String> {
    let (mut x, mut z) = (numbers.length(20), 0.0);
    let mut lines = vec![format!("G0 X{x:.1} Z{z:.1}")];
    for _ in 0..1 + numbers.below(7) {
        x = (x + numbers.length(8) - 3.0).max(0.0);
        z += 0.4 - numbers.length(5);
        lines.push(match numbers.below(4) {
            0 => format!("G2 X{x:.1} Z{z:.1} R{:.1}", 3.0 + numbers.length(6)),
            1 => format!("G3 X{x:.1} Z{z:.1} R{:.1}", 3.0 + numbers.length(6)),
            2 => format!("G1 X{x:.1}"),
            _ => format!("G1 X{x:.1} Z{z:.1}"),
        });
    }
    lines
}

fn motions_of(text: &str, dialect: Dialect) -> (Vec<Motion>, bool) {
    let settings = Settings { dialect: Some(dialect), steps_max: 1_000, ..Settings::default() };
    let (motions, outcome) = interpret(text.as_bytes(), &settings);
    let finite = |motion: &Motion| match motion.kind {
        Kind::Rapid { to } | Kind::Feed { to, .. } | Kind::Arc { to, .. } => {
            [to.x, to.z].iter().all(|place| place.is_finite())
        }
        _ => true,
    };
    assert!(motions.iter().all(finite), "{text}");
    (motions, outcome.is_refused())
}

#[test]
fn contours_at_random_are_cut_or_refused() {
    let mut numbers = Numbers(14);
    let mut cut = [0; 2];
    for _ in 0..4_000 {
        let lines = contour(&mut numbers);
        let (cycle, left) = (numbers.below(7) as usize, numbers.length(1));
        let code = ["G70", "G71", "G71.1", "G71.2", "G72", "G72.1", "G72.2"][cycle];
        let depth = if code == "G70" { "P3 E0.1" } else { "I0.7 R0.3" };
        let body = lines.join("\n");
        let text = format!("G21 G18 G7 F9\no1 sub\n{body}\no1 endsub\nG0 X60 Z1\n{code} Q1 D{left:.1} {depth}\nM2\n");
        cut[0] += usize::from(!motions_of(&text, Dialect::LinuxCnc).1);
        let code = ["G70", "G71", "G72", "G73"][cycle % 4];
        let last = format!("N2 {}", lines[lines.len() - 1]);
        let body = [&lines[..lines.len() - 1], &[last]].concat().join("\n");
        let text = format!("S9 F1.\nG0 X60. Z1.\nG73 U2. W1. R3\n{code} P1 Q2 U{left:.1} D0.7\nN1 {body}\nM30\n");
        cut[1] += usize::from(!motions_of(&text, Dialect::Fanuc).1);
    }
    assert!(cut.iter().all(|cut| *cut > 300), "{cut:?}");
}
