//! What the engine and a board's account in it answer when they are asked.

use super::*;

fn ms(ms: u64) -> Instant {
    Instant::START + Span::from_millis(ms)
}

#[test]
fn the_other_end_is_where_a_port_sends_to_or_else_where_it_hears_from() {
    let mut engine = Engine::new();
    (0..3).for_each(|_| _ = engine.add_node(2));
    let end = |node, port| End { node, port };
    engine.add_line(end(0, 0), end(1, 1));
    assert_eq!(engine.other_end(end(0, 0)), Some(end(1, 1)));
    assert_eq!(engine.other_end(end(1, 1)), Some(end(0, 0)));
    assert_eq!(engine.other_end(end(0, 1)), None);
    engine.add_line(end(1, 1), end(2, 0));
    assert_eq!(engine.other_end(end(1, 1)), Some(end(2, 0)));
}

#[test]
fn a_board_is_awaited_from_its_grant_to_its_answer() {
    let mut engine = Engine::new();
    (0..2).for_each(|_| _ = engine.add_node(2));
    let mut steppers = [0, 1].map(|_| Stepper::new(Chatterbox::new(0, false, Span::ZERO, None)));
    let awaited = |engine: &Engine| [0, 1].map(|node| engine.awaits(node));
    assert_eq!(awaited(&engine), [false; 2]);
    let grants = engine.catch_up(Instant::START.next());
    assert_eq!(grants.iter().map(|(node, _)| *node).collect::<Vec<_>>(), [0, 1]);
    for (node, grant) in grants {
        assert!(engine.awaits(node) && engine.is_waiting());
        engine.answer(node, steppers[node].grant(grant).unwrap()).unwrap();
        assert!(!engine.awaits(node));
    }
    assert_eq!((awaited(&engine), engine.is_waiting()), ([false; 2], false));
}

#[test]
fn a_watch_sees_what_it_looks_out_for_and_nothing_else() {
    let outputs = [
        Output::Event { event: 3, value: 7 },
        Output::Character { port: 3, edges: Vec::new(), end: ms(1) },
        Output::Telemetry { signal: 3, value: 7 },
    ];
    let telemetry = |least, most| Sight::Telemetry { signal: 3, least, most };
    for (what, seen) in [
        (Sight::Event(3), [true, false, false]),
        (Sight::Event(2), [false; 3]),
        (Sight::Character(3), [false, true, false]),
        (Sight::Character(2), [false; 3]),
        (telemetry(7, 7), [false, false, true]),
        (telemetry(8, 9), [false; 3]),
        (telemetry(5, 6), [false; 3]),
        (Sight::Telemetry { signal: 2, least: 0, most: 9 }, [false; 3]),
    ] {
        let watch = Watch { node: 0, what };
        assert_eq!(outputs.each_ref().map(|output| watch.sees(output)), seen, "{what:?}");
    }
}

#[test]
fn a_board_is_behind_up_to_its_horizon_and_quiet_once_it_is_mute() {
    let mut engine = Engine::new();
    engine.add_node(1);
    engine.answer(0, Report { horizon: ms(5), ..Report::default() }).unwrap();
    assert_eq!((engine.is_behind(ms(5)), engine.is_behind(ms(5).next())), (false, true));
    assert!(!engine.is_quiet(), "it may still do something by itself");
    let mute = Report { horizon: Instant::NEVER, mute_since: Some(ms(5)), ..Report::default() };
    engine.answer(0, Report { from: ms(5), ..mute }).unwrap();
    assert!(engine.is_quiet());
}

#[test]
fn what_a_board_has_told_counts_as_redone_if_it_then_hears_something_earlier() {
    let mut node = Node::new(1);
    let told = |at| Timed { at, output: Output::Event { event: 0, value: 0 } };
    let silence = |deadline| Silence { from: ms(1), deadline };
    let report = Report {
        horizon: ms(90),
        outputs: vec![told(ms(20)), told(ms(40))],
        silences: vec![silence(ms(25)), silence(ms(50))],
        ..Report::default()
    };
    node.answer(report);
    let reset = |at| Heard::Stimulus { at, stimulus: Stimulus::Reset };
    node.hear(reset(ms(60)));
    let first = node.grant(ms(100));
    assert_eq!((first.heard.len(), node.statistics.grants, node.statistics.redone), (1, 1, 0));
    assert_eq!(node.silence(), Some(silence(ms(25))));
    node.answer(Report { from: ms(60), horizon: ms(90), ..Report::default() });
    node.hear(reset(ms(30)));
    node.grant(ms(100));
    assert_eq!((node.statistics.grants, node.statistics.redone), (2, 1));
    assert_eq!((node.due(ms(100)), node.silence()), (1, Some(silence(ms(25)))), "what was before is still so");
}

#[test]
fn a_character_breaks_a_silence_only_if_it_comes_before_the_deadline() {
    let silence_with_a_character_at = |at| {
        let mut engine = pair();
        engine.answer(0, waiting(ms(10), ms(60))).unwrap();
        let mut uart = Transmitter::hardware(BAUD, Clock::TRUE);
        uart.push(b'!');
        let loaded = uart.load(at).unwrap();
        let output = Output::Character { port: 0, edges: loaded.edges, end: loaded.end };
        let outputs = vec![Timed { at, output }];
        engine
            .answer(1, Report { outputs, horizon: Instant::NEVER, mute_since: Some(at), ..Report::default() })
            .unwrap();
        engine.poll(Limit { until: ms(40), silence: ms(40) });
        engine.silence().map(|silence| silence.deadline)
    };
    assert_eq!(silence_with_a_character_at(ms(45)), None);
    assert_eq!(silence_with_a_character_at(ms(75)), Some(ms(60)));
}
