//! A running rig: boards in their processes (or all in this one), joined by the time engine.

mod before;
mod cost;
pub mod file;
mod incident;
#[cfg(target_os = "linux")]
pub mod join;
pub mod open;
pub mod place;
mod process;
#[cfg(test)]
mod workpiece;

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::io;
use std::path::PathBuf;
use std::task::{Context, Poll};
use std::time::Duration;

use torno_protocol::board::{Description, Kept, Stimulus, Wait};
use torno_protocol::clock::Clock;
use torno_protocol::layout::{Layout, LineLayout};
use torno_protocol::record::{FromBoard, Grant, Setup, VERSION};
use torno_protocol::stepping::{BrokenPromise, Stepper};
use torno_protocol::time::Instant;

pub use crate::traffic::Bytes;
pub use cost::Cost;
use cost::Stopwatch;
use file::RigFile;
pub use incident::{Incident, ProcessChange};
pub use process::Joined;
use process::{BoardProcess, Children};
use torno_bus::{Conversation, PcUart};
use torno_engine::{
    Disturbance, End, Engine, Fact, FaultId, Hit, Input, InputKind, LateOutput, Limit, LineId, NodeId, Watch, WatchId,
};
use torno_machines::kinds::{self, Steps};

/// How long a board may take over one grant, in wall time. One that is merely slow is waited for.
const SLOW_BOARD: Duration = Duration::from_secs(10);

/// Where the boards run.
#[derive(Clone, Debug)]
pub enum Driver {
    /// Each in a process of its own: this program, started again.
    Processes {
        /// The program; it must understand `board KIND`.
        exe: PathBuf,
    },
    /// All in this process.
    InProcess,
    /// Those that have joined where they are, the others as their driver says.
    ByHand {
        /// Boards that have joined.
        joined: Joined,
        /// Where the others run.
        others: Box<Driver>,
    },
}

impl Driver {
    /// Whether this system can run boards in processes of their own.
    pub const fn has_processes() -> bool {
        process::SUPPORTED
    }

    /// Whether it starts processes.
    const fn launches(&self) -> bool {
        match self {
            Self::Processes { .. } => true,
            Self::InProcess => false,
            Self::ByHand { others, .. } => others.launches(),
        }
    }
}

/// Why a rig cannot go on. It is the rig itself that broke, not the machine in it.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// A board's process cannot be started.
    #[error("cannot start board '{board}'")]
    Launch {
        /// The board.
        board: String,
        /// Why.
        source: io::Error,
    },
    /// A board's process says that it cannot go on.
    #[error("board '{board}': {message}")]
    Board {
        /// The board.
        board: String,
        /// Why.
        message: String,
    },
    /// A board's process sends what is no record, or does not take one.
    #[error("no more records to or from board '{board}'")]
    Record {
        /// The board.
        board: String,
        /// Why.
        source: io::Error,
    },
    /// A board has not answered for ten seconds of wall time.
    #[error("board '{board}' has not answered for {} s", SLOW_BOARD.as_secs())]
    Slow {
        /// The board.
        board: String,
    },
    /// A board contradicts itself.
    #[error("board '{board}'")]
    BrokenPromise {
        /// The board.
        board: String,
        /// How.
        source: BrokenPromise,
    },
    /// A board contradicts what was settled.
    #[error(transparent)]
    LateOutput(#[from] LateOutput),
    /// There is no such board or line.
    #[error("there is no board or line named '{name}'")]
    Unknown {
        /// The name.
        name: String,
    },
    /// The system refuses something.
    #[error("cannot watch the boards' processes")]
    System(#[from] io::Error),
    /// Something outside this process is waited for where nothing should be.
    #[error("a rig whose boards are all in this process waits for something")]
    Waits,
}

enum Seat {
    Local(Box<dyn Steps>),
    Process(Box<BoardProcess>),
    Empty,
}

/// One node of the rig: a board, or the PC's UART.
pub struct Node {
    /// Its name.
    pub name: String,
    /// What it consists of.
    pub description: Description,
    /// Its oscillator.
    pub clock: Clock,
    /// Its process, if it has one of its own.
    pub pid: Option<u32>,
    seat: Seat,
    /// What had gone over its socket before its first grant and, once its process has died, what has gone in all.
    bytes: (Bytes, Option<Bytes>),
}

impl Node {
    fn new(name: &str, description: Description, clock: Clock, seat: Seat) -> Self {
        let pid = match &seat {
            Seat::Process(process) => Some(process.pid().unwrap_or_default()),
            Seat::Local(_) | Seat::Empty => None,
        };
        Self { name: name.to_owned(), description, clock, pid, seat, bytes: (Bytes::default(), None) }
    }

    /// What its grants have taken over the socket.
    fn bytes(&self) -> Option<Bytes> {
        let all = match &self.seat {
            Seat::Process(process) => Some(process.bytes()),
            Seat::Local(_) | Seat::Empty => self.bytes.1,
        };
        all.map(|all| all - self.bytes.0)
    }
}

/// A running rig. Dropping it ends its processes.
pub struct Rig {
    engine: Engine,
    nodes: Vec<Node>,
    layout: Layout,
    pc: NodeId,
    /// Tells of the boards' processes, if there are any.
    children: Option<Children>,
    /// There has been news of the processes that is not noted yet.
    news: bool,
    incidents: Vec<Incident>,
    stopwatch: Option<Stopwatch>,
    inputs: Vec<Input>,
    /// The line of each fault on one.
    faults: BTreeMap<FaultId, LineId>,
}

impl Rig {
    /// Starts the boards of `file`, with `pc` for the UART of the PC's gateway.
    ///
    /// # Errors
    /// [`RigError`] if a board cannot be started.
    pub async fn start<P>(file: &RigFile, driver: &Driver, pc: PcUart<P>) -> Result<Self, RigError>
    where
        P: Conversation + Send + 'static,
    {
        // Before the first process, so that no news of one is missed.
        let children = if driver.launches() { Some(Children::listen()?) } else { None };
        let mut rig = Self {
            engine: Engine::new(),
            nodes: Vec::new(),
            layout: file.layout.clone(),
            pc: file.boards.len(),
            children,
            news: false,
            incidents: Vec::new(),
            stopwatch: None,
            inputs: Vec::new(),
            faults: BTreeMap::new(),
        };
        for board in &file.boards {
            let seat = seat(board, driver)?;
            rig.add_node(Node::new(&board.name, board.description.clone(), board.clock, seat));
        }
        let pc: Box<dyn Steps> = Box::new(Stepper::new(pc));
        rig.add_node(Node::new(&file.pc.name, pc.description(), file.pc.clock, Seat::Local(pc)));
        for gateway in &file.more {
            let uart: Box<dyn Steps> = Box::new(Stepper::new(gateway.uart()));
            rig.add_node(Node::new(&gateway.name, uart.description(), gateway.clock, Seat::Local(uart)));
        }
        file.layout.lines.iter().for_each(|line| rig.add_line(line));
        rig.greet().await?;
        rig.nodes.iter_mut().for_each(|node| node.bytes.0 = node.bytes().unwrap_or_default());
        let first = rig.engine.catch_up(Instant::START.next());
        rig.give(first).await?;
        Ok(rig)
    }

    fn add_node(&mut self, node: Node) {
        self.engine.add_node(node.description.ports.len());
        self.nodes.push(node);
    }

    fn add_line(&mut self, line: &LineLayout) {
        let end = |(node, port): (NodeId, u8)| End { node, port };
        self.engine.add_line(end(line.from), end(line.to));
    }

    /// Waits until every process has said that it is what it should be.
    async fn greet(&mut self) -> Result<(), RigError> {
        for Node { name, description, seat, .. } in &mut self.nodes {
            if let Seat::Process(process) = seat {
                process.introduce(name, description).await?;
            }
        }
        Ok(())
    }

    /// Keeps all processes that were started on the processor that this one runs on: they take turns, so a second one
    /// only adds the cost of waking it.
    pub fn share_one_processor(&self) {
        process::share_one_processor(self.nodes.iter().filter_map(|node| match &node.seat {
            Seat::Process(process) => Some(&**process),
            Seat::Local(_) | Seat::Empty => None,
        }));
    }

    /// Measures from here on what wall time is spent on.
    pub fn measure(&mut self) {
        self.stopwatch = Some(Stopwatch::new(self.nodes.len()));
    }

    /// What each node has cost so far, in the order of the engine's numbers.
    pub fn costs(&self) -> Vec<Cost> {
        let cost = |(id, node): (NodeId, &Node)| Cost {
            name: node.name.clone(),
            statistics: self.engine.statistics(id),
            bytes: node.bytes(),
            wall: self.stopwatch.as_ref().map(|stopwatch| stopwatch.spent(id)).unwrap_or_default(),
        };
        self.nodes.iter().enumerate().map(cost).collect()
    }

    /// The wall time that has passed since it was first [measured](Self::measure).
    pub fn measured(&self) -> Option<Duration> {
        self.stopwatch.as_ref().map(Stopwatch::total)
    }

    fn lap(&mut self) {
        if let Some(stopwatch) = &mut self.stopwatch {
            stopwatch.lap();
        }
    }

    fn charge(&mut self, node: NodeId) {
        if let Some(stopwatch) = &mut self.stopwatch {
            stopwatch.charge(node);
        }
    }

    /// The boards and the PC, in the order of the engine's numbers.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// What it consists of.
    pub const fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The boards that a board waits for, if its quantities have these values.
    pub fn waits_for(&self, node: NodeId, values: &[i64]) -> Vec<String> {
        let mut names = Vec::new();
        for Wait { signal, ports } in &self.nodes[node].description.waits {
            let value = values.get(usize::from(*signal)).copied().unwrap_or_default();
            let set = ports.iter().enumerate().filter(|(bit, _)| value >> bit & 1 == 1);
            let others = set.filter_map(|(_, port)| self.engine.other_end(End { node, port: *port }));
            names.extend(others.map(|end| self.nodes[end.node].name.clone()));
        }
        names
    }

    /// The number of the PC's gateway. Those of the others follow.
    pub const fn pc(&self) -> NodeId {
        self.pc
    }

    /// The time engine.
    pub const fn engine(&self) -> &Engine {
        &self.engine
    }

    /// See [`Engine::active_until`].
    pub fn active_until(&mut self) -> Instant {
        self.engine.active_until()
    }

    /// What has been settled since the last call.
    pub fn take_facts(&mut self) -> Vec<Fact> {
        self.engine.take_facts()
    }

    /// See [`Engine::reuse`].
    pub fn reuse(&mut self, facts: Vec<Fact>) {
        self.engine.reuse(facts);
    }

    /// What has come from outside since the last call, in the order in which it came.
    pub fn take_inputs(&mut self) -> Vec<Input> {
        core::mem::take(&mut self.inputs)
    }

    /// What has become of processes since the last call.
    pub fn take_incidents(&mut self) -> Vec<Incident> {
        core::mem::take(&mut self.incidents)
    }

    /// Gives a node a stimulus at `at`, or as soon after it as nothing settled is touched. Says when.
    pub fn stimulate(&mut self, node: NodeId, at: Instant, stimulus: Stimulus) -> Instant {
        let given = self.engine.frontier();
        let at = self.engine.stimulate(node, at, stimulus.clone());
        self.inputs.push(Input { given, at, what: InputKind::Stimulus { board: node, stimulus } });
        at
    }

    /// Begins a fault on a line at `at`, or as soon after it as nothing settled is touched. Says when.
    pub fn disturb(&mut self, line: LineId, at: Instant, what: &Disturbance) -> (FaultId, Instant) {
        let given = self.engine.frontier();
        let (fault, at) = self.engine.disturb(line, at, what);
        let what = InputKind::Disturbed { line, fault: fault.number(), disturbance: what.clone() };
        self.inputs.push(Input { given, at, what });
        self.faults.insert(fault, line);
        (fault, at)
    }

    /// Ends it, in the same way.
    pub fn heal(&mut self, fault: FaultId, at: Instant) -> Instant {
        let given = self.engine.frontier();
        let at = self.engine.heal(fault, at);
        if let Some(line) = self.faults.get(&fault) {
            self.inputs.push(Input { given, at, what: InputKind::Healed { line: *line, fault: fault.number() } });
        }
        at
    }

    /// Faults that lay in wait for a character and have met it, since the last call.
    pub fn take_fired(&mut self) -> Vec<FaultId> {
        self.engine.take_fired()
    }

    /// See [`Engine::watch`].
    pub fn watch(&mut self, watch: Watch) -> WatchId {
        self.engine.watch(watch)
    }

    /// See [`Engine::unwatch`].
    pub fn unwatch(&mut self, watch: WatchId) {
        self.engine.unwatch(watch);
    }

    /// See [`Engine::take_hits`].
    pub fn take_hits(&mut self) -> Vec<Hit> {
        self.engine.take_hits()
    }

    /// What a board keeps without power, as everything before `until` leaves it. That has been settled. None, if the
    /// board is gone or stopped, or keeps nothing.
    ///
    /// # Errors
    /// [`RigError::Record`] if the board does not understand.
    pub async fn kept(&mut self, node: NodeId, until: Instant) -> Result<Option<Kept>, RigError> {
        let Node { name, seat, .. } = &mut self.nodes[node];
        match seat {
            Seat::Local(stepper) => Ok(stepper.kept(until)),
            Seat::Process(process) => {
                let kept = process.kept(until).await;
                kept.map_err(|source| RigError::Record { board: name.clone(), source })
            }
            Seat::Empty => Ok(None),
        }
    }

    /// Ends a board as the death of its process would, except that no one is told: for a run that is repeated. Says
    /// from when on nothing comes from it.
    pub fn end_board(&mut self, node: NodeId) -> Instant {
        self.nodes[node].seat = Seat::Empty;
        self.engine.kill(node)
    }

    /// Lets everything happen that can happen before `limit`.
    ///
    /// # Errors
    /// [`RigError`] if the rig cannot go on.
    pub async fn advance(&mut self, limit: Limit) -> Result<(), RigError> {
        while self.step(limit).await? {}
        Ok(())
    }

    /// The same by one step; says whether there may be another.
    ///
    /// # Errors
    /// [`RigError`] if the rig cannot go on.
    pub async fn step(&mut self, limit: Limit) -> Result<bool, RigError> {
        let grants = self.engine.poll(limit);
        let some = !grants.is_empty();
        // A board that had been stopped may still owe an answer.
        let owed = self.engine.is_waiting();
        self.give(grants).await?;
        let news = self.has_news().await;
        if news {
            self.look_after_children()?;
        }
        Ok(some || owed || news)
    }

    /// Brings every board towards `until`, however little it has to do, by one report of each. For when the rig is
    /// quiet. Says whether some board has more to tell.
    ///
    /// # Errors
    /// [`RigError`] if the rig cannot go on.
    pub async fn catch_up(&mut self, until: Instant) -> Result<bool, RigError> {
        let grants = self.engine.catch_up(until);
        self.give(grants).await?;
        self.advance(Limit { until, silence: Instant::START }).await?;
        Ok(self.engine.is_behind(until))
    }

    /// Settles what lies before `until`, and nothing of it and later: every board is brought towards it by one report,
    /// whatever silence it waits for. Boards that are stopped or gone stay where they are. Says whether some board has
    /// more to tell.
    ///
    /// # Errors
    /// [`RigError`] if the rig cannot go on.
    pub async fn settle(&mut self, until: Instant) -> Result<bool, RigError> {
        self.advance(Limit::until(until)).await?;
        let grants = self.engine.catch_up(until);
        self.give(grants).await?;
        self.advance(Limit::until(until)).await?;
        Ok(self.engine.is_behind(until))
    }

    /// Waits for news of the processes. The next [step](Self::step) brings the rig up to its limit and then takes note
    /// of it, so that what became of a process is dated when it was learned. Cancel-safe.
    pub async fn news(&mut self) {
        if !self.news {
            poll_fn(|context| self.poll_news(context)).await;
            self.news = true;
        }
    }

    /// Whether there has been news of the processes since the last call.
    async fn has_news(&mut self) -> bool {
        let come = poll_fn(|context| Poll::Ready(self.poll_news(context).is_ready())).await;
        core::mem::take(&mut self.news) || come
    }

    fn poll_news(&mut self, context: &mut Context<'_>) -> Poll<()> {
        if self.children.as_mut().is_some_and(|children| children.poll_news(context).is_ready()) {
            return Poll::Ready(());
        }
        for (id, node) in self.nodes.iter_mut().enumerate() {
            if let Seat::Process(process) = &mut node.seat
                && !self.engine.awaits(id)
                && process.poll_gone(context).is_ready()
            {
                return Poll::Ready(());
            }
        }
        Poll::Pending
    }

    /// Gives boards their grants and waits for their answers.
    async fn give(&mut self, grants: Vec<(NodeId, Grant)>) -> Result<(), RigError> {
        for (id, grant) in grants {
            self.lap();
            let node = &mut self.nodes[id];
            match &mut node.seat {
                Seat::Local(stepper) => {
                    let answer = stepper.grant(grant);
                    let broken = |source| RigError::BrokenPromise { board: node.name.clone(), source };
                    let answer = answer.map_err(broken)?;
                    self.charge(id);
                    self.engine.answer(id, answer)?;
                }
                Seat::Process(process) => {
                    let sent = grant.into_records().try_for_each(|record| process.send(&record));
                    sent.map_err(|source| RigError::Record { board: node.name.clone(), source })?;
                }
                Seat::Empty => {}
            }
        }
        self.collect().await
    }

    /// Waits until every board that has a grant has answered, or will not.
    async fn collect(&mut self) -> Result<(), RigError> {
        if !self.engine.is_waiting() {
            return Ok(());
        }
        let mut patience = std::pin::pin!(tokio::time::sleep(SLOW_BOARD));
        let mut taken = self.taken();
        while self.engine.is_waiting() {
            self.lap();
            let happened = poll_fn(|context| {
                let children = self.children.as_mut();
                if core::mem::take(&mut self.news) || children.is_some_and(|c| c.poll_news(context).is_ready()) {
                    return Poll::Ready(Happened::News);
                }
                for (id, node) in self.nodes.iter_mut().enumerate() {
                    if let Seat::Process(process) = &mut node.seat
                        && self.engine.awaits(id)
                        && let Poll::Ready(answer) = process.poll_receive(context)
                    {
                        return Poll::Ready(Happened::Answer(id, answer));
                    }
                }
                patience.as_mut().poll(context).map(|()| Happened::Nothing)
            });
            match happened.await {
                Happened::News => self.look_after_children()?,
                Happened::Answer(id, answer) => {
                    self.charge(id);
                    self.take_answer(id, answer).await?;
                }
                // A grant that is long, to a board that takes it bit by bit.
                Happened::Nothing if core::mem::replace(&mut taken, self.taken()) != taken => {
                    patience.set(tokio::time::sleep(SLOW_BOARD));
                }
                Happened::Nothing => {
                    let slow = (0..self.nodes.len()).find(|id| self.engine.awaits(*id)).unwrap_or_default();
                    return Err(RigError::Slow { board: self.nodes[slow].name.clone() });
                }
            }
        }
        Ok(())
    }

    /// The bytes that the boards have taken.
    fn taken(&self) -> u64 {
        self.nodes.iter().filter_map(Node::bytes).map(|bytes| bytes.to).sum()
    }

    async fn take_answer(&mut self, id: NodeId, answer: io::Result<Option<FromBoard>>) -> Result<(), RigError> {
        let name = &self.nodes[id].name;
        match answer {
            Ok(Some(FromBoard::Report(report))) => Ok(self.engine.answer(id, report)?),
            Ok(Some(FromBoard::Broken(message))) => Err(RigError::Board { board: name.clone(), message }),
            Ok(Some(FromBoard::Ready { .. } | FromBoard::Told(_) | FromBoard::Kept(_))) => {
                Err(RigError::Board { board: name.clone(), message: "answered what it was not asked".to_owned() })
            }
            Err(source) => Err(RigError::Record { board: name.clone(), source }),
            Ok(None) => {
                let Seat::Process(process) = &mut self.nodes[id].seat else { return Ok(()) };
                let status = process.died().await?;
                self.process_changed(id, ProcessChange::Died(status));
                Ok(())
            }
        }
    }

    fn look_after_children(&mut self) -> Result<(), RigError> {
        for id in 0..self.nodes.len() {
            while let Seat::Process(process) = &mut self.nodes[id].seat
                && let Some(change) = process.change()?
            {
                self.process_changed(id, change);
            }
        }
        Ok(())
    }

    fn process_changed(&mut self, id: NodeId, what: ProcessChange) {
        let given = self.engine.frontier();
        let at = match what {
            ProcessChange::Stopped => self.engine.stop(id),
            ProcessChange::Continued => self.engine.resume(id),
            ProcessChange::Died(_) => {
                if let Seat::Process(process) = &self.nodes[id].seat {
                    self.nodes[id].bytes.1 = Some(process.bytes());
                }
                self.end_board(id)
            }
        };
        let told = self.engine.told(id);
        let input = match what {
            ProcessChange::Stopped => InputKind::Stopped { board: id, told },
            ProcessChange::Continued => InputKind::Continued { board: id },
            ProcessChange::Died(_) => InputKind::Died { board: id, told },
        };
        self.inputs.push(Input { given, at, what: input });
        let Node { name, pid, .. } = &self.nodes[id];
        self.incidents.push(Incident { at, board: name.clone(), pid: pid.unwrap_or_default(), what });
    }
}

enum Happened {
    News,
    Answer(NodeId, io::Result<Option<FromBoard>>),
    Nothing,
}

fn seat(board: &file::Board, driver: &Driver) -> Result<Seat, RigError> {
    let file::Board { name, kind, clock, settings, .. } = board;
    match driver {
        Driver::InProcess => match kinds::build(kind, settings, *clock) {
            Ok(stepper) => Ok(Seat::Local(stepper)),
            Err(error) => Err(RigError::Board { board: name.clone(), message: error.to_string() }),
        },
        Driver::Processes { exe } => match BoardProcess::launch(exe, setup(board)) {
            Ok(process) => Ok(Seat::Process(Box::new(process))),
            Err(source) => Err(RigError::Launch { board: name.clone(), source }),
        },
        Driver::ByHand { joined, others } => match joined.take(name) {
            Some(process) => Ok(Seat::Process(Box::new(process))),
            None => seat(board, others),
        },
    }
}

/// What a board is told to be.
fn setup(board: &file::Board) -> Setup {
    let file::Board { name, kind, clock, settings, .. } = board.clone();
    Setup { version: VERSION, name, kind, clock, settings }
}
