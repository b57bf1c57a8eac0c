//! The engine against the simplest simulator that can be right: one event of the whole rig at a time.

use std::collections::{BTreeSet, VecDeque};

use proptest::prelude::*;
use torno_protocol::clock::Clock;
use torno_protocol::line::Level;
use torno_protocol::stepping::{Cell, Stepper};
use torno_protocol::uart::{Receiver, Transmitter};

mod faults;
mod queries;
mod reference;

use self::reference::Reference;
use super::chatterbox::{BAUD, Chatterbox};
use super::node::KEPT;
use super::*;

impl Engine {
    /// What is kept is what looking at everything gives.
    pub(super) fn check(&mut self) {
        let eits: Vec<Instant> = self.nodes.iter().map(|node| node.eit).collect();
        let computed = self.computed;
        for node in &mut self.nodes {
            node.eit = Instant::NEVER;
            let sending = node.sending.clone();
            node.note_sending();
            assert_eq!(sending, node.sending);
        }
        let mut changed = true;
        while changed {
            changed = false;
            for line in 0..self.lines.len() {
                let (effect, to) = (self.reach(line).effect(), self.lines[line].to.node);
                changed |= effect < self.nodes[to].eit;
                self.nodes[to].eit = self.nodes[to].eit.min(effect);
            }
        }
        self.computed = computed;
        let found: Vec<Instant> = self.nodes.iter().map(|node| node.eit).collect();
        assert_eq!(eits, found);
        let needs = self.nodes.iter().enumerate().map(|(id, node)| (node.needed_at(), id));
        assert_eq!(self.needs, needs.filter(|(need, _)| !need.is_never()).collect());
        assert_eq!(self.waiting, self.nodes.iter().filter(|node| node.awaited && node.life == Life::Runs).count());
        let disturbed: Vec<LineId> = (0..self.lines.len()).filter(|line| self.lines[*line].is_disturbed()).collect();
        assert_eq!(self.disturbed.iter().collect::<Vec<_>>(), disturbed);
        let mut unsure = (0..self.lines.len()).filter(|line| !self.lines[*line].is_sure());
        assert!(unsure.all(|line| self.unsure.first_from(line) == Some(line)));
        let commits = self.nodes.iter().map(|node| node.commit);
        assert_eq!(Some(self.frontier), commits.chain(self.lines.iter().map(Wire::settled)).max());
    }
}

/// A ring: port b of each board talks with port a of the next.
#[derive(Clone, Debug)]
struct Ring {
    boards: Vec<Chatterbox>,
    stimuli: Vec<(NodeId, Instant, Stimulus)>,
    faults: Vec<Fault>,
    /// A board that hears something on its second port makes another one speak.
    reacts: Option<(NodeId, NodeId)>,
    /// Processes that end, are stopped, or go on.
    losses: Vec<(Instant, NodeId, Life)>,
    /// Stimuli are asked for when they happen, and not ahead of time.
    late: bool,
}

/// A fault on a line, and when it is asked for: ahead of time or, at the latest, when it begins.
#[derive(Clone, Debug)]
struct Fault {
    line: LineId,
    asked: Instant,
    from: Instant,
    healed: Option<Healed>,
    what: Disturbance,
}

impl Outcome {
    /// Where it departs from what is expected: the stream, and what comes next in each.
    fn difference(&self, expected: &Self) -> Option<String> {
        for (stream, (found, expected)) in self.facts.iter().zip(&expected.facts).enumerate() {
            let same = found.iter().zip(expected).take_while(|(found, expected)| found == expected).count();
            if found.len() > same || expected.len() > same {
                let next = |facts: &Vec<Fact>| facts.iter().skip(same).take(3).cloned().collect::<Vec<_>>();
                let (found, expected) = (next(found), next(expected));
                return Some(format!("stream {stream}, fact {same}: found {found:?}, expected {expected:?}"));
            }
        }
        let (found, expected) = (&self.fired, &expected.fired);
        (found != expected).then(|| format!("fired: found {found:?}, expected {expected:?}"))
    }
}

impl Fault {
    /// All of it is known from the start.
    fn ask_early(&mut self) {
        self.asked = Instant::START;
        self.healed.iter_mut().for_each(|healed| healed.asked = Instant::START);
    }
}

/// The end of a fault, and when it is asked for: not before the fault is, and at the latest when it comes.
#[derive(Clone, Debug)]
struct Healed {
    asked: Instant,
    at: Instant,
}

/// What comes into a rig from outside at a time.
#[derive(Clone, Copy, Debug)]
enum Request {
    Stimulus(usize),
    Fault(usize),
    Healing(usize),
}

/// What came of a rig: its [facts](streams), and which faults met their character.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Outcome {
    facts: Vec<Vec<Fact>>,
    fired: BTreeSet<usize>,
}

/// What a board that reacts is made to do at `at`.
fn reaction(at: Instant) -> Stimulus {
    Stimulus::Write(vec![at.as_nanos() as u8])
}

impl Ring {
    fn ends(&self) -> Vec<(End, End)> {
        let count = self.boards.len();
        let link = |n: usize| (End { node: n, port: 1 }, End { node: (n + 1) % count, port: 0 });
        (0..count).map(link).flat_map(|(a, b)| [(a, b), (b, a)]).collect()
    }

    /// Everything that is asked for from outside before `until`, in order.
    fn requests(&self, until: Instant) -> VecDeque<(Instant, Request)> {
        let stimuli = self.stimuli.iter().enumerate();
        let stimuli =
            stimuli.map(|(n, (_, at, _))| (if self.late { *at } else { Instant::START }, Request::Stimulus(n)));
        let faults = self.faults.iter().enumerate();
        let begin = faults.clone().map(|(n, fault)| (fault.asked, Request::Fault(n)));
        let end = faults.filter_map(|(n, fault)| fault.healed.as_ref().map(|end| (end.asked, Request::Healing(n))));
        let mut all: Vec<_> = stimuli.chain(begin).chain(end).filter(|(asked, _)| *asked < until).collect();
        all.sort_by_key(|(asked, _)| *asked);
        all.into()
    }

    /// Everything that happens before `until`, with time cut at `cuts` on the way.
    fn run(&self, cuts: &[Instant], until: Instant) -> Outcome {
        let mut engine = Engine::new();
        self.boards.iter().for_each(|_| _ = engine.add_node(2));
        for (from, to) in self.ends() {
            engine.add_line(from, to);
        }
        let stepper = |board| Stepper::new(board).with_report_max(3);
        let mut steppers: Vec<Stepper<Chatterbox>> = self.boards.iter().cloned().map(stepper).collect();
        let mut give = |engine: &mut Engine, grants: Vec<(NodeId, Grant)>| {
            for (node, grant) in grants {
                let report = steppers[node].grant(grant).unwrap();
                engine.answer(node, report).unwrap();
            }
        };
        let first = engine.catch_up(Instant::START.next());
        give(&mut engine, first);
        if let Some((node, _)) = self.reacts {
            engine.watch(Watch { node, what: Sight::Event(1) });
        }
        let mut requests = self.requests(until);
        let mut ids = vec![None; self.faults.len()];
        let mut fired = BTreeSet::new();
        let asked = requests.iter().map(|(asked, _)| *asked).collect::<Vec<_>>();
        let lost = self.losses.iter().map(|(at, ..)| *at);
        let mut limits: Vec<Instant> = cuts.iter().copied().chain([until]).chain(asked).chain(lost).collect();
        limits.sort();
        for limit in limits {
            let mut rounds = 0;
            loop {
                let grants = engine.poll(Limit::until(limit));
                let hits = engine.take_hits();
                if grants.is_empty() && hits.is_empty() {
                    break;
                }
                give(&mut engine, grants);
                for hit in hits {
                    let at = hit.at + REACTION;
                    assert_eq!(engine.stimulate(self.reacts.unwrap().1, at, reaction(at)), at);
                }
                rounds += 1;
                assert!(rounds < 100_000, "no progress");
            }
            while requests.front().is_some_and(|(asked, _)| *asked == limit)
                && let Some((_, request)) = requests.pop_front()
            {
                match request {
                    Request::Stimulus(n) => {
                        let (node, at, stimulus) = self.stimuli[n].clone();
                        assert_eq!(engine.stimulate(node, at, stimulus), at);
                    }
                    Request::Fault(n) => {
                        let fault = &self.faults[n];
                        let (id, at) = engine.disturb(fault.line, fault.from, &fault.what);
                        assert_eq!(at, fault.from);
                        ids[n] = Some(id);
                    }
                    Request::Healing(n) => {
                        let at = self.faults[n].healed.as_ref().unwrap().at;
                        assert_eq!(engine.heal(ids[n].unwrap(), at), at);
                    }
                }
            }
            let lost = self.losses.iter().filter(|(at, ..)| *at == limit);
            if lost.clone().next().is_some() {
                bring_to(limit, &mut engine, &mut give);
            }
            for (_, node, life) in lost {
                _ = match life {
                    Life::Gone => engine.kill(*node),
                    Life::Stopped => engine.stop(*node),
                    Life::Runs => engine.resume(*node),
                };
            }
        }
        bring_to(until, &mut engine, &mut give);
        fired.extend(engine.take_fired().into_iter().filter_map(|id| ids.iter().position(|other| *other == Some(id))));
        Outcome { facts: streams(engine.take_facts(), until), fired }
    }
}

/// Settles everything before `until`.
fn bring_to(until: Instant, engine: &mut Engine, give: &mut impl FnMut(&mut Engine, Vec<(NodeId, Grant)>)) {
    loop {
        let mut grants = engine.catch_up(until);
        while !grants.is_empty() {
            give(engine, grants);
            grants = engine.poll(Limit::until(until));
        }
        engine.poll(Limit::until(until));
        if !engine.is_behind(until) {
            break;
        }
    }
}

/// The facts of each board and the edges of each line before `until`: only their order is determined.
fn streams(facts: Vec<Fact>, until: Instant) -> Vec<Vec<Fact>> {
    let mut streams = vec![Vec::new(); 40];
    for fact in facts {
        match fact {
            Fact::Edges { line, edges } => {
                let edges = edges.into_iter().filter(|edge| edge.at < until);
                let single = edges.map(|edge| Fact::Edges { line, edges: vec![edge] });
                streams[20 + line].extend(single);
            }
            Fact::Telemetry { node, .. } | Fact::Event { node, .. } | Fact::Pin { node, .. } => {
                streams[node].push(fact)
            }
        }
    }
    streams
}

fn instants(ms: std::ops::Range<u64>) -> impl Strategy<Value = Instant> {
    (ms.start * 1_000_000..ms.end * 1_000_000).prop_map(Instant::from_nanos)
}

fn chatterboxes() -> impl Strategy<Value = Chatterbox> {
    let delay = (0..40_000u64).prop_map(Span::from_micros);
    let period = prop::option::of((3_000..700_000u64).prop_map(Span::from_micros));
    (-5_000_000..5_000_000i32, any::<bool>(), delay, period).prop_map(|(ppb, s, delay, period)| {
        // Software receivers leave little room for clock errors.
        Chatterbox::new(ppb, s, delay, period)
    })
}

fn rings() -> impl Strategy<Value = Ring> {
    let boards = prop::collection::vec(chatterboxes(), 2..5);
    let stimulus = prop_oneof![
        4 => prop::collection::vec(any::<u8>(), 1..12).prop_map(Stimulus::Write),
        1 => Just(Stimulus::Reset),
        1 => any::<bool>().prop_map(Stimulus::Power),
        1 => any::<bool>().prop_map(Stimulus::Hang),
        1 => (0..20_000u64).prop_map(|us| Stimulus::Slow(Span::from_micros(us))),
        1 => (-20_000_000..20_000_000i32).prop_map(|ppb| Stimulus::Clock(Clock::from_ppb(ppb).unwrap())),
    ];
    let stimuli = prop::collection::vec((0..2usize, instants(1..3_000), stimulus), 0..9);
    (boards, stimuli).prop_map(|(boards, stimuli)| Ring {
        boards,
        stimuli,
        faults: vec![],
        reacts: None,
        losses: vec![],
        late: false,
    })
}

fn lives() -> impl Strategy<Value = Life> {
    prop_oneof![Just(Life::Gone), Just(Life::Stopped), Just(Life::Runs)]
}

fn disturbances() -> impl Strategy<Value = Disturbance> {
    let tampering = prop_oneof![
        (0..10u8).prop_map(Tampering::Flip),
        (0..10u8, 1..200_000u64).prop_map(|(edge, by)| Tampering::Delay { edge, by: Span::from_nanos(by) }),
        Just(Tampering::Drop),
        Just(Tampering::Double),
    ];
    prop_oneof![
        1 => Just(Disturbance::Cut),
        1 => Just(Disturbance::Stuck(Level::Low)),
        1 => Just(Disturbance::Stuck(Level::High)),
        1 => (0..4usize).prop_map(Disturbance::Short),
        1 => (100..200_000u64, 1..300u64, any::<u64>()).prop_map(|(period, width, seed)| Disturbance::Noise {
            period: Span::from_micros(period),
            width: Span::from_micros(width),
            seed
        }),
        3 => (1..5u64, tampering).prop_map(|(nth, what)| Disturbance::Character { nth, what }),
    ]
}

/// A line that is noisy all the time.
fn noises() -> impl Strategy<Value = Fault> {
    (0..4usize, 100..200_000u64, any::<u64>()).prop_map(|(line, period, seed)| {
        let what = Disturbance::Noise { period: Span::from_micros(period), width: Span::from_micros(50), seed };
        Fault { line, asked: Instant::START, from: Instant::START, healed: None, what }
    })
}

fn faults() -> impl Strategy<Value = Vec<Fault>> {
    let until = prop::option::of((0..1_000_000_000u64).prop_map(Span::from_nanos));
    let fault = (0..4usize, instants(0..3_000), instants(0..3_000), until, disturbances()).prop_filter_map(
        "a wire cannot touch itself",
        |(line, a, b, until, what)| {
            let (asked, from) = (a.min(b), a.max(b));
            let healed = until.map(|span| Healed { asked, at: from + span });
            (what != Disturbance::Short(line)).then_some(Fault { line, asked, from, healed, what })
        },
    );
    prop::collection::vec(fault, 0..4)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn however_time_is_cut_faults_and_reactions_are_the_same(
        ring in rings(),
        faults in faults(),
        reacts in prop::option::of((0..2usize, 0..2usize)),
        mut cuts in prop::collection::vec(instants(0..3_500), 0..30),
    ) {
        cuts.sort();
        let until = Instant::START + Span::from_millis(3_500);
        // Asked for when they begin, and all ahead of time: it is the same.
        let late = Ring { faults, reacts, ..ring };
        let mut early = late.clone();
        early.faults.iter_mut().for_each(|fault| fault.ask_early());
        let expected = late.run(&[], until);
        prop_assert_eq!(&late.run(&cuts, until), &expected);
        prop_assert_eq!(&early.run(&[], until), &expected);
    }

    #[test]
    fn however_time_is_cut_noise_goes_on_whoever_is_lost(
        ring in rings(),
        faults in prop::collection::vec(noises(), 1..3),
        mut losses in prop::collection::vec((instants(0..3_500), 0..2usize, lives()), 1..5),
        mut cuts in prop::collection::vec(instants(0..3_500), 0..30),
    ) {
        losses.sort_by_key(|(at, ..)| *at);
        // No one speaks through a process that is stopped.
        let ring = Ring { stimuli: vec![], faults, losses, ..ring };
        cuts.sort();
        let until = Instant::START + Span::from_millis(3_500);
        prop_assert_eq!(&ring.run(&cuts, until), &ring.run(&[], until));
    }

    #[test]
    fn a_process_that_was_stopped_hung_whatever_noise_it_missed(
        ring in rings(),
        faults in prop::collection::vec(noises(), 1..3),
        node in 0..2usize,
        mut stops in prop::collection::vec(instants(0..3_500), 2..5),
        slice in 300..100_000u64,
    ) {
        stops.sort();
        stops.dedup();
        // Between the first and the last it goes on for no time at all: too short to catch up.
        let (first, last) = (0, stops.len() - 1);
        let lives = stops.iter().enumerate().flat_map(|(n, at)| {
            let runs = (n > first).then_some((*at, node, Life::Runs));
            runs.into_iter().chain((n < last).then_some((*at, node, Life::Stopped)))
        });
        let until = Instant::START + Span::from_millis(3_500);
        let losses: Vec<_> = lives.collect();
        let stimuli = losses.iter().map(|(at, node, life)| (*node, *at, Stimulus::Stop(*life == Life::Stopped)));
        let stimuli = stimuli.collect();
        let stopped = Ring { stimuli: vec![], faults, losses, ..ring };
        let hung = Ring { stimuli, losses: vec![],
            late: false, ..stopped.clone() };
        let cuts = (1..3_500_000 / slice).map(|n| Instant::START + Span::from_micros(n * slice));
        let cuts: Vec<Instant> = cuts.collect();
        prop_assert_eq!(&stopped.run(&cuts, until), &hung.run(&[], until));
    }

    #[test]
    fn however_time_is_cut_everything_happens_as_one_event_at_a_time(
        ring in rings(),
        mut cuts in prop::collection::vec(instants(0..3_500), 0..30),
    ) {
        // Some of them in the character that a stimulus cuts short.
        cuts.extend(ring.stimuli.iter().map(|(_, at, _)| *at - Span::from_nanos(at.as_nanos() % 700_000)));
        cuts.sort();
        let until = Instant::START + Span::from_millis(3_500);
        let expected = Reference::new(&ring).run(until);
        prop_assert_eq!(&ring.run(&cuts, until), &expected);
        prop_assert_eq!(&ring.run(&[], until), &expected);
    }

    #[test]
    fn whatever_stops_and_dies_the_others_go_on(
        ring in rings(),
        mut events in prop::collection::vec((instants(1..3_000), 0..2usize, 0..3u8), 1..6),
    ) {
        events.sort();
        let mut engine = Engine::new();
        ring.boards.iter().for_each(|_| _ = engine.add_node(2));
        ring.ends().into_iter().for_each(|(from, to)| _ = engine.add_line(from, to));
        let mut steppers: Vec<_> = ring.boards.iter().cloned().map(Stepper::new).collect();
        let mut give = |engine: &mut Engine, grants: Vec<(NodeId, Grant)>| {
            for (node, grant) in grants {
                engine.answer(node, steppers[node].grant(grant).unwrap()).unwrap();
            }
        };
        let first = engine.catch_up(Instant::START.next());
        give(&mut engine, first);
        let end = Instant::START + Span::from_secs(5);
        for (at, node, what) in events.into_iter().chain([(end, 0, 3)]) {
            for _ in 0..100_000 {
                let grants = engine.poll(Limit::until(at));
                if grants.is_empty() {
                    break;
                }
                give(&mut engine, grants);
            }
            match what {
                0 => drop(engine.stop(node)),
                1 => drop(engine.resume(node)),
                2 => drop(engine.kill(node)),
                _ => {}
            }
        }
        prop_assert!(!engine.is_waiting());
        prop_assert!(engine.frontier() >= end || engine.is_quiet());
    }
}

/// Two boards with a line each way.
fn pair() -> Engine {
    let mut engine = Engine::new();
    (0..2).for_each(|_| _ = engine.add_node(1));
    let end = |node| End { node, port: 0 };
    engine.add_line(end(0), end(1));
    engine.add_line(end(1), end(0));
    engine
}

/// What a board tells that waits for silence, and is otherwise still.
fn waiting(from: Instant, deadline: Instant) -> Report {
    Report {
        horizon: deadline.next(),
        silences: vec![Silence { from, deadline }],
        ears: vec![Receiver::hardware(BAUD, Clock::TRUE).ear()],
        ..Report::default()
    }
}

#[test]
fn time_goes_no_further_than_a_silence_that_a_board_waits_for() {
    let ms = |ms: u64| Instant::START + Span::from_millis(ms);
    let mut engine = pair();
    engine.answer(0, waiting(ms(10), ms(60))).unwrap();
    let mute = Report { horizon: Instant::NEVER, mute_since: Some(ms(0)), ..waiting(ms(0), ms(0)) };
    engine.answer(1, Report { silences: vec![], ..mute.clone() }).unwrap();
    let silence = |ms| Limit { until: Instant::NEVER, silence: ms };

    assert!(engine.poll(silence(Instant::START)).is_empty());
    assert_eq!((engine.frontier(), engine.next_instant()), (ms(10).next(), ms(60)));
    assert_eq!(engine.silence(), Some(Silence { from: ms(10), deadline: ms(60) }));
    engine.poll(silence(ms(40)));
    assert_eq!(engine.frontier(), ms(40));

    // Someone is about to speak: no time need be lost.
    let mut uart = Transmitter::hardware(BAUD, Clock::TRUE);
    uart.push(b'!');
    let loaded = uart.load(ms(45)).unwrap();
    let output = Output::Character { port: 0, edges: loaded.edges, end: loaded.end };
    let outputs = vec![Timed { at: ms(45), output }];
    engine.answer(1, Report { from: ms(45), outputs, silences: vec![], ..mute }).unwrap();
    assert_eq!(engine.silence(), None);
    let woken: Vec<NodeId> = engine.poll(silence(ms(40))).into_iter().map(|(node, _)| node).collect();
    assert_eq!(woken, [0], "it hears the character");
    engine.answer(0, Report { from: ms(46), ..waiting(ms(46), ms(96)) }).unwrap();
    assert_eq!(engine.silence(), None, "not yet begun");
    engine.poll(silence(ms(40)));
    assert_eq!(engine.silence(), Some(Silence { from: ms(46), deadline: ms(96) }));

    // It has lasted.
    engine.poll(silence(ms(96).next()));
    assert_eq!(engine.silence(), None);
    assert!(engine.frontier() > ms(96));
}

#[test]
fn what_cuts_a_character_short_is_reckoned_with_before_it_is_told() {
    let us = |us: u64| Instant::START + Span::from_micros(us);
    let earliest = |stimulus| {
        let mut node = Node::new(1);
        node.answer(Report { horizon: Instant::NEVER, mute_since: Some(Instant::START), ..Report::default() });
        node.line_busy_until[0] = us(1_042);
        node.hear(Heard::Stimulus { at: us(500), stimulus });
        node.note_sending();
        node.sending[0].earliest_edge(node.eit)
    };
    let stimuli = [Stimulus::Reset, Stimulus::Power(false), Stimulus::Power(true), Stimulus::Hang(true)];
    assert_eq!(stimuli.map(earliest), [us(500), us(500), us(1_042), us(1_042)]);
    assert_eq!(earliest(Stimulus::Stop(false)), us(500), "what has waited for it");
}

#[test]
fn a_stopped_board_goes_on_as_a_hung_one_however_much_it_has_missed() {
    let ms = |ms: u64| Instant::START + Span::from_millis(ms);
    let mut uart = Transmitter::hardware(BAUD, Clock::TRUE);
    // The last one is coming in when the board goes on.
    let edges: Vec<Vec<Edge>> = (0..10_000u64)
        .map(|n| {
            uart.push(n as u8);
            uart.load(ms(100 + 2 * n)).unwrap().edges
        })
        .collect();
    let (stop, resume) = (ms(50), ms(100 + 2 * 9_999).next());
    let chatterbox = || Chatterbox::new(0, false, Span::ZERO, None);
    let hang = |at, hung| Heard::Stimulus { at, stimulus: Stimulus::Stop(hung) };

    let mut expected = Vec::new();
    let mut cell = Cell::new(chatterbox());
    [hang(stop, true), hang(resume, false)].iter().for_each(|heard| cell.hear(heard));
    edges.iter().for_each(|edges| cell.hear(&Heard::Edges { port: 0, edges: edges.clone() }));
    cell.run(ms(21_000), |at, output| expected.push(Timed { at, output }));
    assert!(expected.len() > 3, "the FIFO and the last: {expected:?}");

    let mut node = Node::new(2);
    let mut stepper = Stepper::new(chatterbox());
    let first = node.grant(stop);
    node.answer(stepper.grant(first).unwrap());
    node.stop(stop, Life::Stopped);
    node.hear(hang(stop, true));
    edges.iter().for_each(|edges| node.hear(Heard::Edges { port: 0, edges: edges.clone() }));
    node.life = Life::Runs;
    node.hear(hang(resume, false));
    let grant = node.grant(ms(21_000));
    assert!(grant.heard.len() < 2 * KEPT + 10, "{}", grant.heard.len());
    assert_eq!(stepper.grant(grant).unwrap().outputs, expected);
}

/// What was taken back at the instant after a start edge, and comes again, is the same start.
#[test]
fn a_fault_that_is_asked_for_right_after_a_start_edge_is_the_same_as_one_that_was_known() {
    let ns = Instant::from_nanos;
    let quiet = Chatterbox::new(-3_658_525, true, Span::ZERO, None);
    let speaks = Chatterbox::new(4_862_520, true, Span::ZERO, Some(Span::from_micros(474_433)));
    let (asked, from) = (ns(788_737_210), ns(788_795_582));
    let fault = Fault { line: 1, asked, from, healed: None, what: Disturbance::Cut };
    let late = Ring {
        boards: vec![quiet, speaks],
        stimuli: vec![],
        faults: vec![fault],
        reacts: Some((0, 1)),
        losses: vec![],
        late: false,
    };
    let mut early = late.clone();
    early.faults[0].ask_early();
    let until = ns(3_500_000_000);
    assert_eq!(early.run(&[], until), late.run(&[], until));
}

/// How much the engine looks at for a grant, in a rig of so many pairs of boards that talk, and as many that do not.
fn computed_per_turn(pairs: u64) -> f64 {
    let mut engine = Engine::new();
    let mut steppers = Vec::new();
    for pair in 0..2 * pairs {
        let period = (pair < pairs).then(|| Span::from_micros(20_000 + 371 * pair));
        let [a, b] = [engine.add_node(2), engine.add_node(2)];
        steppers.extend([period, None].map(|p| Stepper::new(Chatterbox::new(0, false, Span::from_millis(3), p))));
        let (end_a, end_b) = (End { node: a, port: 0 }, End { node: b, port: 1 });
        engine.add_line(end_a, end_b);
        engine.add_line(end_b, end_a);
    }
    let mut grants = engine.catch_up(Instant::START.next());
    let mut given = 0;
    while !grants.is_empty() {
        for (node, grant) in grants {
            given += 1;
            engine.answer(node, steppers[node].grant(grant).unwrap()).unwrap();
        }
        grants = engine.poll(Limit::until(Instant::START + Span::from_secs(2)));
    }
    engine.computed as f64 / f64::from(given)
}

#[test]
fn a_turn_costs_the_same_however_many_boards_there_are() {
    let (few, many) = (computed_per_turn(2), computed_per_turn(40));
    assert!(many < 1.2 * few, "{few:.1} and {many:.1} bounds a grant");
}

#[test]
fn a_cut_line_carries_nothing_more() {
    let chatterbox = |period| Chatterbox::new(0, false, Span::ZERO, period);
    let ring = Ring {
        boards: vec![chatterbox(Some(Span::from_millis(20))), chatterbox(None)],
        stimuli: vec![],
        faults: vec![],
        reacts: None,
        losses: vec![],
        late: false,
    };
    let mut engine = Engine::new();
    (0..2).for_each(|_| _ = engine.add_node(2));
    let lines: Vec<LineId> = ring.ends().into_iter().map(|(from, to)| engine.add_line(from, to)).collect();
    let mut steppers: Vec<_> = ring.boards.iter().cloned().map(Stepper::new).collect();
    // In mid-character: the second starts at 40 ms.
    let cut = Instant::START + Span::from_micros(40_300);
    lines.iter().for_each(|line| _ = engine.disturb(*line, cut, &Disturbance::Cut));
    let mut grants = engine.catch_up(Instant::START.next());
    while !grants.is_empty() {
        for (node, grant) in grants {
            engine.answer(node, steppers[node].grant(grant).unwrap()).unwrap();
        }
        grants = engine.poll(Limit::until(Instant::START + Span::from_millis(200)));
    }
    let facts = engine.take_facts();
    let heard = facts.iter().filter(|fact| matches!(fact, Fact::Event { .. })).count();
    assert_eq!(heard, 3, "the first, its answer, and what is left of the second");
    let late = |fact: &Fact| matches!(fact, Fact::Edges { edges, .. } if edges.iter().any(|edge| edge.at > cut));
    assert!(!facts.iter().any(late));
}

#[test]
fn what_would_wake_a_stopped_board_waits_until_it_goes_on() {
    let ms = |ms: u64| Instant::START + Span::from_millis(ms);
    let chatterbox = |period| Chatterbox::new(0, false, Span::ZERO, period);
    let boards = vec![chatterbox(Some(Span::from_millis(20))), chatterbox(Some(Span::from_millis(20)))];
    let ring = Ring { boards, stimuli: vec![], faults: vec![], reacts: None, losses: vec![], late: false };
    let power = |on| Stimulus::Power(on);
    // Asked for while it is stopped, and long before.
    for (asked, stimuli) in [
        (250, [(260, Stimulus::Reset), (270, Stimulus::Reset)]),
        (250, [(260, power(false)), (300, power(true))]),
        (50, [(260, power(false)), (300, power(true))]),
    ] {
        let mut engine = Engine::new();
        (0..2).for_each(|_| _ = engine.add_node(2));
        ring.ends().into_iter().for_each(|(from, to)| _ = engine.add_line(from, to));
        let mut steppers: Vec<_> = ring.boards.iter().cloned().map(Stepper::new).collect();
        let mut run = |engine: &mut Engine, until: u64| {
            let mut grants = engine.catch_up(Instant::START.next());
            loop {
                for (node, grant) in grants {
                    engine.answer(node, steppers[node].grant(grant).unwrap()).unwrap();
                }
                grants = engine.poll(Limit::until(ms(until)));
                if grants.is_empty() {
                    break;
                }
            }
        };
        run(&mut engine, asked.min(200));
        let mut stimuli = Some(stimuli);
        let mut give = |engine: &mut Engine| {
            stimuli.take().into_iter().flatten().for_each(|(at, what)| _ = engine.stimulate(0, ms(at), what));
        };
        if asked < 200 {
            give(&mut engine);
        }
        run(&mut engine, 200);
        engine.stop(0);
        run(&mut engine, 250);
        give(&mut engine);
        run(&mut engine, 500);
        engine.take_facts();
        let resumed = engine.resume(0);
        run(&mut engine, 600);
        let early = |fact: &Fact| match fact {
            Fact::Edges { line: 0 | 3, edges } => edges.iter().any(|edge| edge.at < resumed),
            Fact::Event { node: 0, at, .. } => *at < resumed,
            _ => false,
        };
        let facts = engine.take_facts();
        assert!(!facts.iter().any(early), "asked for at {asked} ms: {facts:?}");
        assert!(facts.iter().any(|fact| matches!(fact, Fact::Edges { line: 3, .. })), "it goes on");
    }
}

/// A reset waits until a stopped process goes on; what its line carries then does not wait with it.
#[test]
fn what_waits_for_a_stopped_board_keeps_nothing_back() {
    let ms = |ms: u64| Instant::START + Span::from_millis(ms);
    let mut engine = Engine::new();
    (0..2).for_each(|_| _ = engine.add_node(2));
    let quiet = || Chatterbox::new(0, false, Span::ZERO, None);
    let ring = Ring {
        boards: vec![quiet(), quiet()],
        stimuli: vec![],
        faults: vec![],
        reacts: None,
        losses: vec![],
        late: false,
    };
    let lines: Vec<LineId> = ring.ends().into_iter().map(|(from, to)| engine.add_line(from, to)).collect();
    let mut steppers: Vec<_> = ring.boards.into_iter().map(Stepper::new).collect();
    let mut give = |engine: &mut Engine, grants: Vec<(NodeId, Grant)>| {
        for (node, grant) in grants {
            engine.answer(node, steppers[node].grant(grant).unwrap()).unwrap();
        }
    };
    bring_to(ms(50), &mut engine, &mut give);
    engine.stop(0);
    engine.stimulate(0, ms(60), Stimulus::Reset);
    engine.disturb(lines[0], ms(70), &Disturbance::Stuck(Level::Low));
    bring_to(ms(100), &mut engine, &mut give);
    let low = Fact::Edges { line: lines[0], edges: vec![Edge { at: ms(70), level: Level::Low }] };
    assert!(engine.take_facts().contains(&low));
}
