//! Every kind of line fault, in any number and order, against the reference simulator.

use super::*;

/// Within a few milliseconds from here on most of the talk and most of the faults meet one another.
const CROWD: Instant = Instant::from_nanos(700_000_000);
const UNTIL: Instant = Instant::from_nanos(2_500_000_000);

fn moments() -> impl Strategy<Value = Instant> {
    prop_oneof![
        3 => (0..12_000_000u64).prop_map(|ns| CROWD + Span::from_nanos(ns)),
        // Exactly where another one is.
        1 => (0..12u64).prop_map(|ms| CROWD + Span::from_millis(ms)),
        1 => instants(0..2_400),
        1 => Just(Instant::START),
    ]
}

fn lengths() -> impl Strategy<Value = Span> {
    prop_oneof![0..1_000_000_000u64, 0..10_000_000u64, 0..1_000_000u64, Just(0)].prop_map(Span::from_nanos)
}

/// As early as may be, as late as may be, or between.
fn between(early: Instant, late: Instant, quarters: u64) -> Instant {
    if quarters == 4 { late } else { early + Span::from_nanos(late.since(early).as_nanos() / 4 * quarters) }
}

/// A fault on one of so many lines. Half of all are on the second line, on which most is said.
fn a_fault(lines: usize) -> impl Strategy<Value = Fault> {
    let line = prop_oneof![Just(1), 0..lines];
    let heals = prop::option::weighted(0.7, (lengths(), any::<bool>(), 0..=4u64));
    (line, 1..lines, moments(), 0..=4u64, disturbances(), heals).prop_map(
        move |(line, other, from, quarters, what, heals)| {
            // Any other line.
            let what = if let Disturbance::Short(_) = what { Disturbance::Short((line + other) % lines) } else { what };
            let asked = between(Instant::START, from, quarters);
            let healed = heals.map(|(length, early, quarters)| {
                // Some end before they begin.
                let at = if early { asked.max(from - length) } else { from + length };
                Healed { asked: between(asked, at, quarters), at }
            });
            Fault { line, asked, from, healed, what }
        },
    )
}

fn rigs() -> impl Strategy<Value = Ring> {
    let bytes = prop::collection::vec(prop_oneof![any::<u8>(), Just(0xff), Just(0)], 1..8);
    let writes = prop::collection::vec((moments(), bytes.prop_map(Stimulus::Write)), 0..5);
    let stops = prop::collection::vec((moments(), any::<bool>().prop_map(Stimulus::Stop)), 0..3);
    let reacts = prop::option::of((0..2usize, 0..2usize));
    (rings(), writes, stops, reacts, any::<bool>()).prop_flat_map(|(ring, writes, stops, reacts, late)| {
        let more = [writes, stops].concat().into_iter().map(|(at, stimulus)| (1, at, stimulus));
        let stimuli = ring.stimuli.into_iter().chain(more).collect();
        let faults = prop::collection::vec(a_fault(2 * ring.boards.len()), 0..8);
        let ring = Ring { stimuli, reacts, late, ..ring };
        (Just(ring), faults).prop_map(|(ring, mut faults)| {
            // Of those that begin together, the one that was asked for first acts first.
            faults.sort_by_key(|fault| fault.asked);
            Ring { faults, ..ring }
        })
    })
}

proptest! {
    // The number of cases is proptest's own: PROPTEST_CASES raises it.
    #[test]
    fn every_fault_does_what_it_does_one_event_at_a_time(
        ring in rigs(),
        mut cuts in prop::collection::vec(moments(), 0..12),
    ) {
        cuts.sort();
        let expected = Reference::new(&ring).run(UNTIL);
        prop_assert_eq!(ring.run(&cuts, UNTIL).difference(&expected), None);
        let mut early = Ring { late: false, ..ring };
        early.faults.iter_mut().for_each(Fault::ask_early);
        prop_assert_eq!(early.run(&[], UNTIL).difference(&expected), None);
    }
}

/// One wire of a short hands on less than the other, which is sound when the short is over and forgets what was driven.
#[test]
fn the_wires_of_a_short_see_what_both_drove_until_it_ended() {
    let at = Instant::from_nanos;
    let boards = vec![
        Chatterbox::new(458_650, false, Span::from_micros(20_722), Some(Span::from_micros(96_149))),
        Chatterbox::new(4_090_133, true, Span::from_micros(20_364), Some(Span::from_micros(43_867))),
    ];
    let stimuli = vec![
        (1, at(2_903_500_513), Stimulus::Reset),
        (0, at(1_217_510_966), Stimulus::Write(vec![225])),
        (0, at(1_118_636_737), Stimulus::Clock(Clock::from_ppb(-19_700_784).unwrap())),
        (0, at(1_033_215_865), Stimulus::Clock(Clock::from_ppb(99_704).unwrap())),
        (0, at(210_453_045), Stimulus::Power(false)),
        (1, at(705_000_000), Stimulus::Write(vec![255])),
        (1, at(708_396_039), Stimulus::Write(vec![118, 255, 255])),
        (1, at(704_000_000), Stimulus::Stop(false)),
        (1, Instant::START, Stimulus::Stop(true)),
    ];
    let fault = |line, from, healed: Option<u64>, what| {
        let healed = healed.map(|ns| Healed { asked: Instant::START, at: at(ns) });
        Fault { line, asked: Instant::START, from: at(from), healed, what }
    };
    let faults = vec![
        fault(3, 706_111_993, None, Disturbance::Stuck(Level::Low)),
        fault(3, 700_000_000, None, Disturbance::Short(2)),
        fault(1, 708_000_000, Some(709_143_895), Disturbance::Short(2)),
    ];
    let ring = Ring { boards, stimuli, faults, reacts: Some((1, 1)), losses: vec![], late: false };
    assert_eq!(ring.run(&[], UNTIL).difference(&Reference::new(&ring).run(UNTIL)), None);
}
