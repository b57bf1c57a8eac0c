//! What a rig of several masters with three slaves each costs, as their number grows.
//!
//! A rig has one PC, so in `torno run` one master works and the others idle. What many that work cost the time engine
//! is measured on the engine itself, in this process: each master has a PC of its own and plays the same program, each
//! a little later than the one before, so that they need their grants at different times.

use std::time::{Duration, Instant as WallInstant};

use torno::job::Careful;
use torno::rig::file::RigFile;
use torno_engine::{End, Engine, Limit, NodeId};
use torno_machines::kinds::{self, Steps};
use torno_protocol::board::Stimulus;
use torno_protocol::lathe::Program;
use torno_protocol::record::Grant;
use torno_protocol::stepping::Stepper;
use torno_protocol::time::{Instant, Span};

/// So much later does each PC begin.
const LATER: Span = Span::from_millis(37);

/// What it cost.
pub(crate) struct Cost {
    pub(crate) virtual_s: f64,
    pub(crate) wall: Duration,
    /// Grants of boards, without the PCs'.
    pub(crate) grants: u64,
}

/// Plays the demonstration on so many masters at once, all in this process.
pub(crate) fn all_at_work(masters: usize) -> Cost {
    let start = WallInstant::now();
    let file = RigFile::load("lathe").unwrap();
    let mut engine = Engine::new();
    let mut steppers: Vec<Box<dyn Steps>> = Vec::new();
    let mut boards = Vec::new();
    let mut pcs = Vec::new();
    for _ in 0..masters {
        let first = steppers.len();
        for board in &file.boards {
            steppers.push(kinds::build(&board.kind, &board.settings, board.clock).unwrap());
            boards.push(engine.add_node(board.description.ports.len()));
        }
        let uart = file.pc.uart().with_program(Careful::default());
        steppers.push(Box::new(Stepper::new(uart)));
        let pc = engine.add_node(1);
        pcs.push(pc);
        let on = |(board, port): (usize, u8)| End { node: first + board, port };
        for line in &file.layout.lines {
            engine.add_line(on(line.from), on(line.to));
        }
    }
    let first = engine.catch_up(Instant::START.next());
    give(&mut engine, &mut steppers, first);
    let program = Program::parse(include_str!("../../harness/builtin/shaft.frames")).unwrap();
    let mut at = Instant::START + Span::from_millis(10);
    for pc in pcs {
        engine.stimulate(pc, at, Stimulus::Write(program.bytes()));
        at += LATER;
    }
    let mut facts = 0;
    loop {
        let grants = engine.poll(Limit::NONE);
        facts += engine.take_facts().len();
        if grants.is_empty() {
            break;
        }
        give(&mut engine, &mut steppers, grants);
    }
    assert!(engine.is_quiet() && facts > 0);
    Cost {
        virtual_s: engine.quiet_since().as_secs_f64(),
        wall: start.elapsed(),
        grants: boards.iter().map(|board| engine.statistics(*board).grants).sum(),
    }
}

fn give(engine: &mut Engine, steppers: &mut [Box<dyn Steps>], grants: Vec<(NodeId, Grant)>) {
    for (node, grant) in grants {
        engine.answer(node, steppers[node].grant(grant).unwrap()).unwrap();
    }
}
