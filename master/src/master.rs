//! The master board: the conversation with the PC on one side, with the slaves on the other.
//!
//! The slaves' ports follow that of the PC, in the order of [`Slave::ALL`].

use torno_protocol::board::{Board, Capability, Deadline, Description, Input, Output, Stimulus, Wait};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{CHARACTER, ENQ, Fault, Frame, RATE, Slave};
use torno_protocol::settings;
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Receiver, TickTimer, Transmitter};

use crate::reception::{Beginning, Order, PC, Reception, START_UP, Slaves};
use crate::supervision::{Due, Patience, Report, Supervision};

/// Silence between an enquiry and the next sub-frame on a link. An enquiry can cross the slave's `ACK`; after this
/// silence it cannot be taken for the first byte of a sub-frame, and its answer has come: two characters after the
/// slave's gap of three, behind the two that it crossed. (Ours.)
const AFTER_ENQUIRY: Span = CHARACTER.times(7);

settings! {
    /// The master's settings in the rig file.
    pub struct MasterSettings {
        /// How often a busy slave is asked whether it is there.
        enquiry_period_ms: u32 = 1_000, 100..=10_000, "ms", "ours";
        /// How long it may take to answer. An idle axis takes 6.3 ms: one character for the enquiry, a gap of three to
        /// be sure of it, and two for the answer.
        answer_ms: u32 = 20, 8..=1_000, "ms", "ours";
        /// How many enquiries in a row may go unanswered. Two enquiries after a sub-frame are more than a slave's
        /// receiver holds, so one that hangs until it is given up finds an overrun and executes nothing.
        enquiries: u32 = 3, 2..=10, "", "ours";
    }
}

impl MasterSettings {
    fn patience(&self, clock: Clock) -> Patience {
        let ms = |ms: u32| clock.span(Span::from_millis(u64::from(ms)));
        Patience { period: ms(self.enquiry_period_ms), answer: ms(self.answer_ms), enquiries: self.enquiries }
    }
}

/// The master board.
#[derive(Clone, Debug)]
pub struct Master {
    settings: MasterSettings,
    clock: Clock,
    /// In which the software UARTs live.
    timer: TickTimer,
    reception: Reception,
    links: Links,
    /// Failures that came before the frame's `ACK`.
    failures: Vec<(Slave, Fault)>,
}

/// The software UARTs, and what goes over them.
#[derive(Clone, Debug)]
struct Links {
    links: [Link; 3],
    distribution: Option<Distribution>,
}

/// One software UART and the slave at its other end.
#[derive(Clone, Debug)]
struct Link {
    transmitter: Transmitter,
    supervision: Supervision,
    /// No sub-frame may start before.
    clear_at: Instant,
}

/// A frame on its way to the slaves.
#[derive(Clone, Copy, Debug)]
enum Distribution {
    /// It must wait for the links to be clear of enquiries.
    Waiting { frame: Frame, until: Instant },
    /// Its bytes are in the transmitters.
    Sending,
}

/// The events of the links. They come after those of the reception.
#[derive(Clone, Copy)]
enum Event {
    LineError,
    OutOfPlace,
    Back,
}

impl Event {
    const TEXTS: [&str; 3] =
        ["line error from slave '{c}'", "a byte from slave '{c}' makes no sense", "slave '{c}' answers again"];
}

impl Master {
    /// A master as at power-on.
    pub fn new(settings: &MasterSettings, clock: Clock) -> Self {
        let timer = TickTimer::new(RATE, clock);
        let links = Links::new(&timer, settings.patience(clock), Instant::START + clock.span(START_UP));
        let reception = Reception::new(clock, Beginning::WithTheMachine);
        Self { settings: settings.clone(), clock, timer, reception, links, failures: Vec::new() }
    }

    /// The firmware restarts: because its supply has come, or for another reason.
    fn restart(&mut self, now: Instant, power_on: bool) {
        let ready = now + self.clock.span(START_UP);
        self.links = Links::new(&self.timer, self.settings.patience(self.clock), ready);
        self.failures.clear();
        (PC..=3).for_each(|port| self.reception.put(Output::Cut { port }));
        let beginning = if power_on { Beginning::WithTheMachine } else { Beginning::Alone(ready) };
        self.reception.restart(self.clock, beginning);
    }

    fn retune(&mut self, now: Instant, clock: Clock) {
        self.clock = clock;
        self.timer.retune(now, clock);
        self.reception.retune(clock);
        self.links.retune(&self.timer, self.settings.patience(clock));
    }

    fn event(&mut self, event: Event, slave: Slave) {
        let value = i64::from(slave.letter());
        self.reception.put(Output::Event { event: Reception::EVENTS + event as u8, value });
    }

    fn hear_pc(&mut self, now: Instant, character: Character) {
        match self.reception.hear(now, character, &self.links) {
            Some(Order::Start(frame)) => self.distribute(now, frame),
            Some(Order::Enquire(slave)) => self.links.enquire(now, slave),
            None => {}
        }
    }

    fn distribute(&mut self, now: Instant, frame: Frame) {
        if self.links.distribute(now, frame) {
            self.reception.report_busy(&self.links);
        }
    }

    /// Every slave has its sub-frame.
    fn distributed(&mut self, now: Instant) {
        self.links.distribution = None;
        self.reception.distributed();
        for (slave, fault) in core::mem::take(&mut self.failures) {
            self.reception.fail(now, slave, fault);
        }
        self.check_done(now);
    }

    fn check_done(&mut self, now: Instant) {
        if let Some(frame) = self.reception.check_done(&self.links) {
            self.distribute(now, frame);
        }
    }

    fn hear_slave(&mut self, now: Instant, slave: Slave, character: Character) {
        let supervision = &mut self.links.links[slave as usize].supervision;
        let Some(byte) = character.ok() else {
            supervision.spoilt();
            self.event(Event::LineError, slave);
            return;
        };
        let was_unknown = supervision.is_unknown();
        let report = supervision.byte(now, byte);
        let found_at_work = was_unknown && !supervision.is_unknown() && report != Report::Started;
        if found_at_work {
            self.reception.report_busy(&self.links);
            self.reception.found_at_work(now);
        }
        match report {
            Report::Done | Report::Started => {
                self.reception.report_busy(&self.links);
                self.check_done(now);
            }
            Report::Failed(fault) => self.slave_failed(now, slave, fault),
            Report::Back => {
                self.event(Event::Back, slave);
                self.reception.report_busy(&self.links);
            }
            Report::OutOfPlace => self.event(Event::OutOfPlace, slave),
            Report::Nothing => {}
        }
    }

    fn slave_failed(&mut self, now: Instant, slave: Slave, fault: Fault) {
        self.reception.report_busy(&self.links);
        if self.links.distribution.is_some() {
            self.failures.push((slave, fault));
            return;
        }
        self.reception.fail(now, slave, fault);
        self.check_done(now);
    }

    fn handle_deadlines(&mut self, now: Instant) {
        if let Some(frame) = self.reception.handle_timeout(now, &self.links) {
            self.distribute(now, frame);
        }
        match self.links.distribution {
            Some(Distribution::Waiting { frame, until }) if until <= now => self.distribute(now, frame),
            Some(Distribution::Sending) if self.links.are_idle(now) => self.distributed(now),
            _ => {}
        }
        for slave in Slave::ALL {
            let supervision = &mut self.links.links[slave as usize].supervision;
            if supervision.poll_timeout().is_some_and(|at| at <= now) {
                match supervision.handle_timeout(now) {
                    Due::Enquiry => self.links.enquire(now, slave),
                    Due::Lost => self.slave_failed(now, slave, Fault::NoAnswer),
                    Due::Nothing => {}
                }
            }
        }
    }

    /// Loads whatever shift registers are free.
    fn load(&mut self, now: Instant) {
        self.reception.load(now);
        for (port, link) in (PC + 1..).zip(&mut self.links.links) {
            if let Some(loaded) = link.transmitter.load(now) {
                self.reception.put(Output::Character { port, edges: loaded.edges, end: loaded.end });
            }
        }
    }
}

impl Slaves for Links {
    fn are_busy(&self) -> bool {
        self.distribution.is_some() || self.links.iter().any(|link| link.supervision.is_busy())
    }

    fn busy(&self) -> [bool; 3] {
        self.links.each_ref().map(|link| link.supervision.is_busy() && !link.supervision.is_unknown())
    }

    fn lost_for(&self, frame: &Frame) -> Option<Slave> {
        let needed = |slave| match slave {
            Slave::Spindle => frame.spindle.units() != 0,
            Slave::Transverse => frame.transverse.distance() != 0,
            Slave::Depth => frame.depth.distance() != 0,
        };
        Slave::ALL.into_iter().find(|slave| needed(*slave) && self.links[*slave as usize].supervision.is_lost())
    }
}

impl Links {
    /// Idle links to slaves that are asked from `ready` on.
    fn new(timer: &TickTimer, patience: Patience, ready: Instant) -> Self {
        let link = |n| Link {
            transmitter: timer.transmitter(n),
            supervision: Supervision::new(patience, ready),
            clear_at: Instant::START,
        };
        Self { links: [link(0), link(1), link(2)], distribution: None }
    }

    fn retune(&mut self, timer: &TickTimer, patience: Patience) {
        for (n, link) in (0..).zip(&mut self.links) {
            link.transmitter.keep_pace_with(&timer.transmitter(n));
            link.supervision.retune(patience);
        }
    }

    fn are_idle(&self, now: Instant) -> bool {
        self.links.iter().all(|link| link.transmitter.is_idle(now))
    }

    fn enquire(&mut self, now: Instant, slave: Slave) {
        let link = &mut self.links[slave as usize];
        link.transmitter.push(ENQ);
        // The enquiry starts within a tick and takes a character.
        link.clear_at = now + CHARACTER.times(2) + AFTER_ENQUIRY;
    }

    /// Puts the sub-frames into the transmitters: all start on the same tick. Says whether it could do so already.
    fn distribute(&mut self, now: Instant, frame: Frame) -> bool {
        let clear = self.links.iter().map(|link| link.clear_at).max().unwrap_or(now);
        if clear > now {
            self.distribution = Some(Distribution::Waiting { frame, until: clear });
            return false;
        }
        let (spindle, transverse, depth) = (frame.spindle.emit(), frame.transverse.emit(), frame.depth.emit());
        let sub_frames: [&[u8]; 3] = [&spindle, &transverse, &depth];
        for (link, sub_frame) in self.links.iter_mut().zip(sub_frames) {
            sub_frame.iter().for_each(|byte| link.transmitter.push(*byte));
            link.supervision.start(now);
        }
        self.distribution = Some(Distribution::Sending);
        true
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let loads = self.links.iter().filter_map(|link| link.transmitter.poll_timeout());
        let watches = self.links.iter().filter_map(|link| link.supervision.poll_timeout());
        let distribution = match self.distribution {
            None => None,
            Some(Distribution::Waiting { until, .. }) => Some(until),
            Some(Distribution::Sending) => self.links.iter().map(|link| link.transmitter.free_at()).max(),
        };
        loads.chain(watches).chain(distribution).min()
    }
}

impl Board for Master {
    fn description(&self) -> Description {
        Description {
            ports: ["pc", "spindle", "transverse", "depth"].map(str::to_owned).to_vec(),
            signals: Reception::signals(),
            events: Reception::events().into_iter().chain(Event::TEXTS.map(str::to_owned)).collect(),
            waits: vec![Wait { signal: Reception::BUSY, ports: vec![1, 2, 3] }],
            capabilities: vec![Capability::Reset],
            motors: Vec::new(),
            pins: Vec::new(),
        }
    }

    fn receivers(&self) -> Vec<Receiver> {
        let links = (0..3).map(|n| self.timer.receiver(n));
        core::iter::once(Receiver::hardware(RATE, self.clock)).chain(links).collect()
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        match input {
            Input::Character { port: PC, character } => self.hear_pc(now, character),
            Input::Character { port, character } => {
                if let Some(slave) = Slave::ALL.get(usize::from(port) - 1) {
                    self.hear_slave(now, *slave, character);
                }
            }
            Input::Stimulus(Stimulus::Reset) => self.restart(now, false),
            Input::Stimulus(Stimulus::Power(_)) => self.restart(now, true),
            Input::Stimulus(Stimulus::Clock(clock)) => self.retune(now, clock),
            Input::Stimulus(_) => {}
        }
        self.load(now);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.handle_deadlines(now);
        self.load(now);
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.reception.poll_output()
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let own = self.reception.poll_timeout().into_iter().chain(self.links.poll_timeout()).min();
        let own = own.map(|at| Deadline { at, why: "a transmitter or a slave's answer" });
        let silence = self.silence().map(|at| Deadline { at, why: "silence on the PC's line" });
        own.into_iter().chain(silence).min_by_key(|deadline| deadline.at)
    }

    fn silence(&self) -> Option<Instant> {
        self.reception.silence()
    }
}
