//! The master board: the conversation with the PC on one side, with the slaves on the other.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};
use torno_protocol::board::{Board, Deadline, Description, Heeds, Input, Output, Signal, Stimulus, Wait};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{CHARACTER, ENQ, Fault, Frame, Party, RATE, Refusal, Reply, Slave, XOFF, XON};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Receiver, TickTimer, Transmitter};

use crate::assembly::{Assembly, Bytes};
use crate::supervision::{Due, Patience, Report, Supervision};

/// The port to the PC; the slaves' ports follow, in the order of [`Slave::ALL`].
const PC: u8 = 0;
/// Silence between an enquiry and the next sub-frame on a link. An enquiry can cross the slave's `ACK`; after this
/// silence it cannot be taken for the first byte of a sub-frame, and its answer has come: two characters after the
/// slave's gap of three, behind the two that it crossed. (Ours.)
const AFTER_ENQUIRY: Span = CHARACTER.times(7);
/// The master is silent for so long after its start: longer than a character that the start has cut short, so that none
/// spoils what it says first. (Ours.)
const START_UP: Span = Span::from_millis(2);

/// The master's settings in the rig file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MasterSettings {
    /// How often a busy slave is asked whether it is there, in milliseconds. Default 1000, range 100…10 000.
    pub enquiry_period_ms: u32,
    /// How long it may take to answer, in milliseconds. Default 20, range 8…1000: an idle axis takes 6.3 ms, one
    /// character for the enquiry, a gap of three to be sure of it, and two for the answer.
    pub answer_ms: u32,
    /// How many enquiries in a row may go unanswered. Default 3, range 2…10: two enquiries after a sub-frame are more
    /// than a slave's receiver holds, so one that hangs until it is given up finds an overrun and executes nothing.
    pub enquiries: u32,
}

impl Default for MasterSettings {
    fn default() -> Self {
        Self { enquiry_period_ms: 1000, answer_ms: 20, enquiries: 3 }
    }
}

impl MasterSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Which setting is out of range, and the range.
    pub fn check(&self) -> Result<(), String> {
        let ranges = [
            ("enquiry_period_ms", self.enquiry_period_ms, 100..=10_000),
            ("answer_ms", self.answer_ms, 8..=1000),
            ("enquiries", self.enquiries, 2..=10),
        ];
        match ranges.iter().find(|(_, value, range)| !range.contains(value)) {
            Some((name, value, range)) => {
                Err(format!("{name} = {value}: expected {} to {}", range.start(), range.end()))
            }
            None => Ok(()),
        }
    }

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
    firmware: Firmware,
    outputs: VecDeque<Output>,
}

/// Everything that a reset loses.
#[derive(Clone, Debug)]
struct Firmware {
    beginning: Beginning,
    assembly: Assembly,
    pc: Transmitter,
    links: [Link; 3],
    distribution: Option<Distribution>,
    /// A frame that has come while slaves are busy.
    held: Option<Frame>,
    /// Failures that came before the frame's `ACK`.
    failures: Vec<(Slave, Fault)>,
    distributed: i64,
}

/// One software UART and the slave at its other end.
#[derive(Clone, Debug)]
struct Link {
    transmitter: Transmitter,
    supervision: Supervision,
    /// No sub-frame may start before.
    clear_at: Instant,
}

/// What the PC must be told of the master's start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Beginning {
    /// Its supply has come. For all that is known, so has everybody's: nobody waits for anything.
    WithTheMachine,
    /// It has started anew amid the machine's work. The PC is to be told then.
    Alone(Instant),
    /// No more: it has been told, or need not be.
    Over,
}

/// A frame on its way to the slaves.
#[derive(Clone, Copy, Debug)]
enum Distribution {
    /// It must wait for the links to be clear of enquiries.
    Waiting { frame: Frame, until: Instant },
    /// Its bytes are in the transmitters.
    Sending,
}

/// The quantities in the telemetry.
#[derive(Clone, Copy)]
enum Quantity {
    FramesDistributed,
    FrameHeld,
    SlavesBusy,
}

/// The events. Refusals and failures come after these, one each.
#[derive(Clone, Copy)]
enum Event {
    Distributed,
    Held,
    AllDone,
    Reset,
    PcFramingError,
    PcOverrun,
    SlaveLineError,
    SlaveOutOfPlace,
    SlaveBack,
    SlaveLost,
    SlaveStalled,
    SlaveEndOfTravel,
    SlaveGarbled,
    SlaveRestarted,
}

impl Event {
    const TEXTS: [&str; 14] = [
        "frame {} distributed",
        "frame held: slaves are busy",
        "all slaves done",
        "reset",
        "framing error on the line from the PC",
        "overrun on the line from the PC",
        "line error from slave '{c}'",
        "a byte from slave '{c}' makes no sense",
        "slave '{c}' answers again",
        "slave '{c}' does not answer",
        "slave '{c}' reports: stalled",
        "slave '{c}' reports: end of travel",
        "slave '{c}' reports: sub-frame garbled",
        "slave '{c}' reports: restarted",
    ];
}

impl Master {
    /// A master as at power-on.
    pub fn new(settings: &MasterSettings, clock: Clock) -> Self {
        let timer = TickTimer::new(RATE, clock);
        let firmware = Firmware::new(Instant::START, true, clock, &timer, settings.patience(clock));
        Self { settings: settings.clone(), clock, timer, firmware, outputs: VecDeque::new() }
    }

    /// The firmware starts anew: because its supply has come, or for another reason.
    fn restart(&mut self, now: Instant, power_on: bool) {
        let patience = self.settings.patience(self.clock);
        self.firmware = Firmware::new(now, power_on, self.clock, &self.timer, patience);
        self.outputs.extend((PC..=3).map(|port| Output::Cut { port }));
        self.event(Event::Reset, 0);
        for quantity in [Quantity::FramesDistributed, Quantity::FrameHeld, Quantity::SlavesBusy] {
            self.telemetry(quantity, 0);
        }
    }

    fn retune(&mut self, now: Instant, clock: Clock) {
        self.clock = clock;
        self.timer.retune(now, clock);
        self.firmware.retune(clock, &self.timer, self.settings.patience(clock));
    }

    fn event(&mut self, event: Event, value: i64) {
        self.outputs.push_back(Output::Event { event: event as u8, value });
    }

    fn telemetry(&mut self, quantity: Quantity, value: i64) {
        self.outputs.push_back(Output::Telemetry { signal: quantity as u8, value });
    }

    fn reply(&mut self, reply: Reply) {
        reply.emit().into_iter().for_each(|byte| self.firmware.pc.push(byte));
    }

    fn refuse(&mut self, refusal: Refusal) {
        let place = Refusal::ALL.iter().position(|other| *other == refusal).unwrap_or_default();
        let event = (Event::TEXTS.len() + place) as u8;
        self.outputs.push_back(Output::Event { event, value: 0 });
        self.reply(Reply::Nak(refusal));
    }

    fn hear_pc(&mut self, now: Instant, character: Character) {
        if character.framing_error {
            self.event(Event::PcFramingError, i64::from(character.byte));
        }
        if character.overrun {
            self.event(Event::PcOverrun, i64::from(character.byte));
        }
        match self.firmware.assembly.character(now, character) {
            Some(Ok(bytes)) => self.receive(now, bytes),
            Some(Err(refusal)) => self.refuse(refusal),
            None => {}
        }
    }

    /// The paper's rule: if a process is running in any stage, the sending is delayed until all have finished, and the
    /// PC is informed (§3).
    fn receive(&mut self, now: Instant, bytes: Bytes) {
        match Frame::parse(bytes) {
            Err(refusal) => self.refuse(refusal),
            Ok(_) if self.firmware.held.is_some() => self.refuse(Refusal::Overrun),
            Ok(frame) if self.firmware.is_busy() => {
                self.firmware.held = Some(frame);
                self.event(Event::Held, 0);
                self.telemetry(Quantity::FrameHeld, 1);
                self.firmware.assembly.hold(true);
                self.reply(Reply::Xoff);
            }
            Ok(frame) => match self.firmware.lost_slave_for(&frame) {
                Some(slave) => {
                    self.refuse(Refusal::Faulted);
                    // If it answers this, the next frame is executed.
                    self.firmware.enquire(now, slave);
                }
                None => self.distribute(now, frame),
            },
        }
    }

    /// Tells the PC that the master has started anew amid the machine's work. What was held is lost, and whether the PC
    /// is held is not known: it is taken to be, so that its silence counts from the `XON`.
    fn confess(&mut self, now: Instant) {
        self.reply(Reply::Can(Party::Master, Fault::Restarted));
        self.firmware.assembly.hold(true);
        self.firmware.assembly.stop(now);
        self.give_up(now);
    }

    fn distribute(&mut self, now: Instant, frame: Frame) {
        let clear = self.firmware.links.iter().map(|link| link.clear_at).max().unwrap_or(now);
        if clear > now {
            self.firmware.distribution = Some(Distribution::Waiting { frame, until: clear });
            return;
        }
        self.firmware.send(now, &frame);
        self.report_busy();
    }

    /// Every slave has its part.
    fn distributed(&mut self, now: Instant) {
        self.firmware.distribution = None;
        self.firmware.distributed += 1;
        let frames = self.firmware.distributed;
        self.event(Event::Distributed, frames);
        self.telemetry(Quantity::FramesDistributed, frames);
        self.reply(Reply::Ack);
        for (slave, fault) in core::mem::take(&mut self.firmware.failures) {
            self.fail(now, slave, fault);
        }
        self.check_done(now);
    }

    fn hear_slave(&mut self, now: Instant, slave: Slave, character: Character) {
        let letter = i64::from(slave.letter());
        let supervision = &mut self.firmware.links[slave as usize].supervision;
        let Some(byte) = character.ok() else {
            supervision.spoilt();
            self.event(Event::SlaveLineError, letter);
            return;
        };
        let was_unknown = supervision.is_unknown();
        let report = supervision.byte(now, byte);
        let found_at_work = was_unknown && !supervision.is_unknown() && report != Report::Started;
        if found_at_work {
            self.report_busy();
            if self.firmware.beginning == Beginning::WithTheMachine {
                self.confess(now);
            }
        }
        match report {
            Report::Done | Report::Started => {
                self.report_busy();
                self.check_done(now);
            }
            Report::Failed(fault) => self.slave_failed(now, slave, fault),
            Report::Back => {
                self.event(Event::SlaveBack, letter);
                self.report_busy();
            }
            Report::OutOfPlace => self.event(Event::SlaveOutOfPlace, letter),
            Report::Nothing => {}
        }
    }

    fn slave_failed(&mut self, now: Instant, slave: Slave, fault: Fault) {
        self.report_busy();
        if self.firmware.distribution.is_some() {
            self.firmware.failures.push((slave, fault));
            return;
        }
        self.fail(now, slave, fault);
        self.check_done(now);
    }

    /// Tells the PC.
    fn fail(&mut self, now: Instant, slave: Slave, fault: Fault) {
        let event = match fault {
            Fault::NoAnswer => Event::SlaveLost,
            Fault::Stalled => Event::SlaveStalled,
            Fault::EndOfTravel => Event::SlaveEndOfTravel,
            Fault::Garbled => Event::SlaveGarbled,
            Fault::Restarted => Event::SlaveRestarted,
        };
        self.event(event, i64::from(slave.letter()));
        self.reply(Reply::Can(slave.into(), fault));
        self.give_up(now);
    }

    /// What was held is not executed, and nothing more is accepted until the PC's line has been silent: with one frame
    /// missing, the relative frames that follow would turn a different part.
    fn give_up(&mut self, now: Instant) {
        self.firmware.beginning = Beginning::Over;
        if self.firmware.held.take().is_some() {
            self.telemetry(Quantity::FrameHeld, 0);
        }
        self.firmware.assembly.abandon(now);
    }

    fn check_done(&mut self, now: Instant) {
        if self.firmware.is_busy() {
            return;
        }
        let beginning = core::mem::replace(&mut self.firmware.beginning, Beginning::Over);
        if beginning == Beginning::WithTheMachine && self.firmware.held.is_none() {
            return;
        }
        self.event(Event::AllDone, 0);
        self.reply(Reply::Xon);
        self.firmware.assembly.hold(false);
        if let Some(frame) = self.firmware.held.take() {
            self.telemetry(Quantity::FrameHeld, 0);
            self.distribute(now, frame);
        }
    }

    fn report_busy(&mut self) {
        let busy = |link: &Link| link.supervision.is_busy() && !link.supervision.is_unknown();
        let mask = self.firmware.links.iter().rev().fold(0, |mask, link| mask << 1 | i64::from(busy(link)));
        self.telemetry(Quantity::SlavesBusy, mask);
    }

    fn handle_deadlines(&mut self, now: Instant) {
        if matches!(self.firmware.beginning, Beginning::Alone(at) if at <= now) {
            self.confess(now);
            self.check_done(now);
        }
        if self.firmware.assembly.poll_timeout().is_some_and(|at| at <= now)
            && let Some(refusal) = self.firmware.assembly.handle_silence()
        {
            self.refuse(refusal);
        }
        match self.firmware.distribution {
            Some(Distribution::Waiting { frame, until }) if until <= now => self.distribute(now, frame),
            Some(Distribution::Sending) if self.firmware.links.iter().all(|link| link.transmitter.is_idle(now)) => {
                self.distributed(now);
            }
            _ => {}
        }
        for slave in Slave::ALL {
            let supervision = &mut self.firmware.links[slave as usize].supervision;
            if supervision.poll_timeout().is_some_and(|at| at <= now) {
                match supervision.handle_timeout(now) {
                    Due::Enquiry => self.firmware.enquire(now, slave),
                    Due::Lost => self.slave_failed(now, slave, Fault::NoAnswer),
                    Due::Nothing => {}
                }
            }
        }
    }

    /// Loads whatever shift registers are free.
    fn load(&mut self, now: Instant) {
        if let Some(loaded) = self.firmware.pc.load(now) {
            match loaded.byte {
                XOFF => self.firmware.assembly.stop(now),
                XON => self.firmware.assembly.go_on(now),
                _ => {}
            }
            self.outputs.push_back(Output::Character { port: PC, edges: loaded.edges, end: loaded.end });
        }
        for (port, link) in (PC + 1..).zip(&mut self.firmware.links) {
            if let Some(loaded) = link.transmitter.load(now) {
                self.outputs.push_back(Output::Character { port, edges: loaded.edges, end: loaded.end });
            }
        }
    }
}

impl Firmware {
    fn new(now: Instant, power_on: bool, clock: Clock, timer: &TickTimer, patience: Patience) -> Self {
        let ready = now + clock.span(START_UP);
        let link = |n| Link {
            transmitter: timer.transmitter(n),
            supervision: Supervision::new(patience, ready),
            clear_at: Instant::START,
        };
        Self {
            beginning: if power_on { Beginning::WithTheMachine } else { Beginning::Alone(ready) },
            assembly: Assembly::new(clock),
            pc: Transmitter::hardware(RATE, clock),
            links: [link(0), link(1), link(2)],
            distribution: None,
            held: None,
            failures: Vec::new(),
            distributed: 0,
        }
    }

    fn retune(&mut self, clock: Clock, timer: &TickTimer, patience: Patience) {
        self.assembly.retune(clock);
        self.pc.retune(RATE, clock);
        for (n, link) in (0..).zip(&mut self.links) {
            link.transmitter.keep_pace_with(&timer.transmitter(n));
            link.supervision.retune(patience);
        }
    }

    fn is_busy(&self) -> bool {
        let begins = matches!(self.beginning, Beginning::Alone(_));
        begins || self.distribution.is_some() || self.links.iter().any(|link| link.supervision.is_busy())
    }

    /// A slave that does not answer and that the frame would move.
    fn lost_slave_for(&self, frame: &Frame) -> Option<Slave> {
        let needed = |slave| match slave {
            Slave::Spindle => frame.spindle.units() != 0,
            Slave::Transverse => frame.transverse.distance() != 0,
            Slave::Depth => frame.depth.distance() != 0,
        };
        Slave::ALL.into_iter().find(|slave| needed(*slave) && self.links[*slave as usize].supervision.is_lost())
    }

    fn enquire(&mut self, now: Instant, slave: Slave) {
        let link = &mut self.links[slave as usize];
        link.transmitter.push(ENQ);
        // The enquiry starts within a tick and takes a character.
        link.clear_at = now + CHARACTER.times(2) + AFTER_ENQUIRY;
    }

    /// Puts the three parts into the transmitters: all start on the same tick.
    fn send(&mut self, now: Instant, frame: &Frame) {
        let (spindle, transverse, depth) = (frame.spindle.emit(), frame.transverse.emit(), frame.depth.emit());
        let parts: [&[u8]; 3] = [&spindle, &transverse, &depth];
        for (link, part) in self.links.iter_mut().zip(parts) {
            part.iter().for_each(|byte| link.transmitter.push(*byte));
            link.supervision.start(now);
        }
        self.distribution = Some(Distribution::Sending);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let transmitters = self.links.iter().map(|link| &link.transmitter).chain([&self.pc]);
        let loads = transmitters.filter_map(Transmitter::poll_timeout);
        let watches = self.links.iter().filter_map(|link| link.supervision.poll_timeout());
        let distribution = match self.distribution {
            None => None,
            Some(Distribution::Waiting { until, .. }) => Some(until),
            Some(Distribution::Sending) => self.links.iter().map(|link| link.transmitter.free_at()).max(),
        };
        let beginning = match self.beginning {
            Beginning::Alone(at) => Some(at),
            Beginning::WithTheMachine | Beginning::Over => None,
        };
        loads.chain(watches).chain(distribution).chain(beginning).min()
    }
}

impl Board for Master {
    fn description(&self) -> Description {
        let refusals = Refusal::ALL.iter().map(|refusal| format!("frame refused: {refusal}"));
        Description {
            ports: ["pc", "spindle", "transverse", "depth"].map(str::to_owned).to_vec(),
            signals: ["frames_distributed", "frame_held", "slaves_busy"].map(|name| Signal::new(name, 0)).to_vec(),
            events: Event::TEXTS.map(str::to_owned).into_iter().chain(refusals).collect(),
            waits: vec![Wait { signal: Quantity::SlavesBusy as u8, ports: vec![1, 2, 3] }],
            heeds: vec![Heeds::Reset],
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
        self.outputs.pop_front()
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let own = self.firmware.poll_timeout().map(|at| Deadline { at, why: "a transmitter or a slave's answer" });
        let silence = self.silence().map(|at| Deadline { at, why: "silence on the PC's line" });
        own.into_iter().chain(silence).min_by_key(|deadline| deadline.at)
    }

    fn silence(&self) -> Option<Instant> {
        self.firmware.assembly.poll_timeout()
    }
}
