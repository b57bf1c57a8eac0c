//! Lets a recorded session happen again: the same rig, and the same things from outside at the same instants.

use std::collections::BTreeMap;

use torno_protocol::board::Stimulus;
use torno_protocol::time::Instant;

use crate::job::{Careful, Counting};
use crate::rig::Driver;
use crate::rig::file::{RigFile, RigFileError};
use crate::session::{Audience, Session, SessionError};
use torno_engine::{Disturbance, Fact, Input, InputKind, Limit, LineId, NodeId};
use torno_trace::{Header, Trace};

/// What came of a session that was repeated.
#[derive(Clone, Debug)]
pub struct Replayed {
    /// The session, without an end of its own.
    pub trace: Trace,
    /// The digest of everything that happened.
    pub digest: String,
}

/// What happens again that was not recorded is kept up to so many facts and edges. A recording says itself when it
/// ends, and may be wrong.
const SURPLUS: usize = 200_000;

/// Why a session cannot be repeated.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The rig in the trace is none for this version of torno.
    #[error(
        "the rig in this trace, which torno {torno} recorded, cannot be built by torno {}",
        env!("CARGO_PKG_VERSION")
    )]
    File {
        /// The version that recorded it.
        torno: String,
        /// Why.
        source: RigFileError,
    },
    /// This version makes something else of it.
    #[error(
        "the rig in this trace, which torno {torno} recorded, has other boards or lines in torno {}",
        env!("CARGO_PKG_VERSION")
    )]
    Other {
        /// The version that recorded it.
        torno: String,
    },
    /// The rig broke.
    #[error(transparent)]
    Session(#[from] SessionError),
}

/// Something to be done to the rig.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Action {
    Stimulate(NodeId, Instant, Stimulus),
    Disturb(LineId, Instant, u32, Disturbance),
    Heal(Instant, u32),
    /// Nothing more comes from the board.
    End(NodeId),
}

/// Repeats a session up to the instant that its trace goes to.
///
/// # Errors
/// [`ReplayError`].
pub async fn replay(trace: &Trace, driver: &Driver) -> Result<Replayed, ReplayError> {
    show(trace, driver, None).await
}

/// The same for an audience, which then sets the pace.
///
/// # Errors
/// [`ReplayError`].
pub async fn show(
    trace: &Trace,
    driver: &Driver,
    audience: Option<Box<dyn Audience>>,
) -> Result<Replayed, ReplayError> {
    let (file, header) = rig_of(trace)?;
    let Header { program, .. } = &header;
    let uart = file.pc.uart();
    let session = match program {
        // A PC that the machine does not hold is outside the rig, whatever it plays.
        Some(_) if file.pc.dialect.holds_the_pc() => {
            Session::start(&file, driver, uart.with_program(Careful::default())).await?
        }
        Some(_) if file.pc.dialect.counts_characters() => {
            Session::start(&file, driver, uart.with_program(Counting::default())).await?
        }
        _ => Session::start(&file, driver, uart).await?,
    };
    let mut session = session.quiet();
    match audience {
        Some(audience) => session.show(audience),
        None => session.rig().share_one_processor(),
    }
    session.keep(header.clone());
    // Faults have other numbers here: watches are numbered with them.
    let mut faults = BTreeMap::new();
    let mut room = SURPLUS + weight(&trace.facts);
    for (when, action) in actions(&trace.inputs) {
        run(&mut session, when, &mut room).await?;
        let rig = session.rig_mut();
        match action {
            Action::Stimulate(board, at, stimulus) => drop(rig.stimulate(board, at, stimulus)),
            Action::Disturb(line, at, number, what) => {
                faults.insert(number, rig.disturb(line, at, &what).0);
            }
            Action::Heal(at, number) => {
                if let Some(fault) = faults.get(&number) {
                    rig.heal(*fault, at);
                }
            }
            Action::End(board) => {
                settle(&mut session, when, &mut room).await?;
                session.rig_mut().end_board(board);
            }
        }
    }
    let until = trace.until();
    run(&mut session, until, &mut room).await?;
    settle(&mut session, until, &mut room).await?;
    if room > 0 {
        session.reach_end(until, |_| ()).await?;
    }
    let ended = session.close("replayed")?;
    let trace = ended.trace.map(|trace| Trace { end: None, ..trace });
    Ok(Replayed { digest: ended.end.digest, trace: trace.unwrap_or_else(|| Trace::new(header)) })
}

/// The rig in a trace, and the header that a trace of it has today.
///
/// # Errors
/// [`ReplayError`] if this version cannot build it.
pub fn rig_of(trace: &Trace) -> Result<(RigFile, Header), ReplayError> {
    let Header { torno, rig: name, text, seed, program, .. } = &trace.header;
    let file = RigFile::parse(name, text).map_err(|source| ReplayError::File { torno: torno.clone(), source })?;
    let header = file.header(name, *seed, program.as_deref());
    if header.layout == trace.header.layout {
        Ok((file, header))
    } else {
        Err(ReplayError::Other { torno: torno.clone() })
    }
}

/// Lets everything happen before `until`, as long as there is `room` for it. Others have their turn, even if all boards
/// are in this process.
async fn run(session: &mut Session, until: Instant, room: &mut usize) -> Result<(), SessionError> {
    while *room > 0 {
        let happened = session.step(Limit::until(until)).await?;
        *room = room.saturating_sub(weight(&happened.facts));
        if !happened.more {
            break;
        }
        tokio::task::yield_now().await;
    }
    Ok(())
}

/// Brings every board to `until`, in the same way.
async fn settle(session: &mut Session, until: Instant, room: &mut usize) -> Result<(), SessionError> {
    while *room > 0 {
        let happened = session.settle_on(until).await?;
        *room = room.saturating_sub(weight(&happened.facts));
        if !happened.more {
            break;
        }
        tokio::task::yield_now().await;
    }
    Ok(())
}

/// How much there is of these facts, however the edges of a line are put together.
fn weight(facts: &[Fact]) -> usize {
    let one = |fact: &Fact| if let Fact::Edges { edges, .. } = fact { edges.len() } else { 1 };
    facts.iter().map(one).sum()
}

/// What is to be done, and how far the rig is to have come by then: no further than when the input came, nor than from
/// when on it held.
///
/// A process that was stopped and continued hung in between. Of one that was never continued nothing has come since
/// what it had told, not even of its motor: it is as good as dead.
pub(crate) fn actions(inputs: &[Input]) -> Vec<(Instant, Action)> {
    let mut actions = Vec::new();
    let mut stopped: Vec<(NodeId, usize, Instant, Instant)> = Vec::new();
    for (place, Input { given, at, what }) in inputs.iter().enumerate() {
        let when = *given.min(at);
        match what {
            InputKind::Stimulus { board, stimulus } => {
                actions.push((when, place, Action::Stimulate(*board, *at, stimulus.clone())));
            }
            InputKind::Disturbed { line, fault, disturbance } => {
                actions.push((when, place, Action::Disturb(*line, *at, *fault, disturbance.clone())));
            }
            InputKind::Healed { fault, .. } => actions.push((when, place, Action::Heal(*at, *fault))),
            InputKind::Stopped { board, told } => {
                if stopped.iter().all(|(other, ..)| other != board) {
                    stopped.push((*board, place, *at, *told));
                }
            }
            InputKind::Continued { board } => {
                if let Some(n) = stopped.iter().position(|(other, ..)| other == board) {
                    let (board, since, from, _) = stopped.swap_remove(n);
                    actions.push((from, since, Action::Stimulate(board, from, Stimulus::Stop(true))));
                    actions.push((when, place, Action::Stimulate(board, *at, Stimulus::Stop(false))));
                }
            }
            InputKind::Died { board, told } => {
                stopped.retain(|(other, ..)| other != board);
                actions.push((*told, place, Action::End(*board)));
            }
        }
    }
    // What came first is given first.
    actions.sort_by_key(|(_, place, _)| *place);
    let mut next = Instant::NEVER;
    for (when, ..) in actions.iter_mut().rev().filter(|(.., action)| !matches!(action, Action::End(_))) {
        next = next.min(*when);
        *when = next;
    }
    actions.extend(stopped.into_iter().map(|(board, place, _, told)| (told, place, Action::End(board))));
    actions.sort_by_key(|(when, place, _)| (*when, *place));
    actions.into_iter().map(|(when, _, action)| (when, action)).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use torno_protocol::board::MotorStimulus;
    use torno_protocol::clock::Clock;
    use torno_protocol::line::Level;
    use torno_protocol::time::Span;

    use super::*;
    use torno_engine::Tampering;
    use torno_trace::diff::{Extent, first_difference};

    fn input(at: u64, what: InputKind) -> Input {
        Input { given: Instant::from_nanos(at + 2), at: Instant::from_nanos(at), what }
    }

    fn ns(ns: u64) -> Instant {
        Instant::from_nanos(ns)
    }

    #[test]
    fn a_process_that_was_stopped_and_continued_hung() {
        let inputs =
            [input(50, InputKind::Stopped { board: 1, told: ns(20) }), input(70, InputKind::Continued { board: 1 })];
        let stop = |stops, at| (ns(at), Action::Stimulate(1, ns(at), Stimulus::Stop(stops)));
        assert_eq!(actions(&inputs), [stop(true, 50), stop(false, 70)]);
    }

    #[test]
    fn nothing_comes_from_a_process_that_was_not_continued_or_died() {
        let stopped = input(50, InputKind::Stopped { board: 1, told: ns(20) });
        let died = input(90, InputKind::Died { board: 1, told: ns(20) });
        let end = [(ns(20), Action::End(1))];
        assert_eq!(actions(std::slice::from_ref(&stopped)), end);
        assert_eq!(actions(std::slice::from_ref(&died)), end);
        assert_eq!(actions(&[stopped, died]), end);
    }

    #[test]
    fn what_holds_later_is_given_when_it_was() {
        let disturbance = Disturbance::Cut;
        let what = InputKind::Disturbed { line: 3, fault: 7, disturbance: disturbance.clone() };
        let cut = Input { given: ns(0), at: ns(5_000), what };
        let write = input(30, InputKind::Stimulus { board: 4, stimulus: Stimulus::Discard });
        let cut_then = (ns(0), Action::Disturb(3, ns(5_000), 7, disturbance));
        let expected = [cut_then, (ns(30), Action::Stimulate(4, ns(30), Stimulus::Discard))];
        assert_eq!(actions(&[cut, write]), expected);
    }

    #[test]
    fn what_came_first_is_given_first() {
        let disturbance = Disturbance::Stuck(Level::Low);
        let begins =
            Input { given: ns(90), at: ns(100), what: InputKind::Disturbed { line: 3, fault: 7, disturbance } };
        let ends = Input { given: ns(80), at: ns(200), what: InputKind::Healed { line: 3, fault: 7 } };
        let begun = Action::Disturb(3, ns(100), 7, Disturbance::Stuck(Level::Low));
        assert_eq!(actions(&[begins, ends]), [(ns(80), begun), (ns(80), Action::Heal(ns(200), 7))]);
    }

    /// Something that somebody does to a rig while it runs: how long after what was before, to what, and what.
    type Deed = (u64, usize, Result<Stimulus, Disturbance>);

    fn deeds() -> impl Strategy<Value = Vec<Deed>> {
        let tampering = prop_oneof![
            (0..10u8).prop_map(Tampering::Flip),
            (0..10u8, 0..200u64).prop_map(|(edge, us)| Tampering::Delay { edge, by: Span::from_micros(us) }),
            Just(Tampering::Drop),
            Just(Tampering::Double),
        ];
        let disturbance = prop_oneof![
            Just(Disturbance::Cut),
            Just(Disturbance::Stuck(Level::Low)),
            Just(Disturbance::Stuck(Level::High)),
            (1..8usize).prop_map(Disturbance::Short),
            any::<u64>().prop_map(|seed| Disturbance::Noise {
                period: Span::from_millis(5),
                width: Span::from_micros(90),
                seed
            }),
            (1..9u64, tampering.clone()).prop_map(|(nth, what)| Disturbance::Character { nth, what }),
            (1..3u64, tampering).prop_map(|(nth, what)| Disturbance::Character { nth, what }),
        ];
        let stimulus = prop_oneof![
            Just(Stimulus::Reset),
            any::<bool>().prop_map(Stimulus::Hang),
            any::<bool>().prop_map(Stimulus::Stop),
            any::<bool>().prop_map(Stimulus::Power),
            any::<bool>().prop_map(|value| MotorStimulus::Stall(value).of(0)),
            (0..500u64).prop_map(|us| Stimulus::Slow(Span::from_micros(us))),
            (-40_000_000..40_000_000).prop_map(|ppb| Stimulus::Clock(Clock::from_ppb(ppb).unwrap())),
            Just(Stimulus::Write(vec![0x0a, 0xe1, 0, 0xe1, 0, 0, 1, 0])),
        ];
        let deed = prop_oneof![stimulus.prop_map(Ok), disturbance.prop_map(Err)];
        let after = prop_oneof![Just(0), 0..3_000u64, 0..300_000u64];
        prop::collection::vec((after, 0..8usize, deed), 1..12)
    }

    /// Lets a rig run; who does something does it at once, and heals it by and by.
    async fn disturbed(deeds: &[Deed]) -> (Trace, String) {
        let file = RigFile::load("lathe").unwrap();
        let header = file.header("lathe", 0, None);
        let mut session = Session::start(&file, &Driver::InProcess, file.pc.uart()).await.unwrap().quiet();
        session.keep(header);
        let pc = session.rig().pc();
        let frame = vec![0x0a, 0xe1, 0, 0xe1, 0, 0, 1, 0];
        session.stimulate(pc, ns(10_000_000), Stimulus::Write([&frame[..], &frame, &frame].concat()));
        let mut now = ns(10_000_000);
        for (after, place, deed) in deeds {
            now += Span::from_micros(*after);
            // Not all of the rig is where the first board of it is.
            let mut steps = after % 7;
            while session.step(Limit::until(now)).await.unwrap().more && (steps > 0 || *after > 1_000) {
                steps = steps.saturating_sub(1);
            }
            let rig = session.rig_mut();
            match deed {
                Ok(stimulus @ Stimulus::Write(_)) => drop(rig.stimulate(pc, now, stimulus.clone())),
                Ok(stimulus) => drop(rig.stimulate(place % 5, Instant::START, stimulus.clone())),
                Err(Disturbance::Short(other)) if other == place => {}
                Err(disturbance) => {
                    let (fault, since) = rig.disturb(*place, Instant::START, disturbance);
                    rig.heal(fault, since + Span::from_millis(1 + after % 60));
                }
            }
        }
        let until = now.max(session.rig().engine().frontier()) + Span::from_secs(2);
        let ended = session.finish(until, "ended", |_| ()).await.unwrap();
        (Trace { end: None, ..ended.trace.unwrap() }, ended.end.digest)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 200, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]
        #[test]
        fn whatever_is_done_to_a_rig_is_repeated(deeds in deeds()) {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            let (trace, digest) = runtime.block_on(disturbed(&deeds));
            let again = runtime.block_on(replay(&trace, &Driver::InProcess)).unwrap();
            let difference = first_difference(&trace, &again.trace, Extent::Whole, torno_machines::dialect);
            prop_assert_eq!(difference.map(|difference| difference.text("recorded", "repeated")), None);
            prop_assert_eq!(again.digest, digest);
            prop_assert_eq!(again.trace.inputs.len(), trace.inputs.len());
        }
    }

    /// What did not get through a fault on a line does not come when the next one begins.
    #[test]
    fn a_second_cut_does_not_bring_back_what_the_first_has_swallowed() {
        let deeds = [
            (143_206, 0, Ok(MotorStimulus::Stall(false).of(0))),
            (60_910, 0, Err(Disturbance::Stuck(Level::High))),
            (217_854, 0, Ok(MotorStimulus::Stall(false).of(0))),
            (1_869, 0, Err(Disturbance::Cut)),
            (838, 0, Ok(Stimulus::Write(vec![10, 225, 0, 225, 0, 0, 1, 0]))),
            (59_334, 0, Ok(Stimulus::Reset)),
            (0, 0, Err(Disturbance::Cut)),
        ];
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let (trace, digest) = runtime.block_on(disturbed(&deeds));
        assert_eq!(runtime.block_on(replay(&trace, &Driver::InProcess)).unwrap().digest, digest);
    }
}
