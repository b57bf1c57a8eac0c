//! The conversation with the PC: which frames are executed, which are held or refused, and what the PC is told. It is
//! the same whoever executes the frames.

use std::collections::VecDeque;

use torno_protocol::board::{Output, Role, Signal};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{Fault, Frame, FrameDecoder, Party, RATE, Refusal, Reply, Slave, XOFF, XON};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Transmitter};

/// The port to the PC; other ports follow.
pub const PC: u8 = 0;
/// A board is silent for so long after its start: longer than a character that the start has cut short, so that none
/// spoils what it says first. (Ours.)
pub const START_UP: Span = Span::from_millis(2);

/// Those who execute frames, as far as the PC is concerned.
pub trait Slaves {
    /// A frame is being given to them or executed, for all that is known.
    fn are_busy(&self) -> bool;

    /// Those that are known to be executing, in the order of [`Slave::ALL`].
    fn busy(&self) -> [bool; 3];

    /// One that does not answer and that the frame would move.
    fn lost_for(&self, frame: &Frame) -> Option<Slave>;
}

/// What a character of the PC calls for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The frame is to be executed. Once every slave has its sub-frame, [`Reception::distributed`] is to be told.
    Start(Frame),
    /// The frame is refused because this slave does not answer. If it answers an enquiry, the next is executed.
    Enquire(Slave),
}

/// What the PC must be told of the board's start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beginning {
    /// Its supply has come. For all that is known, so has everybody's: no one waits for anything.
    WithTheMachine,
    /// It has restarted amid the machine's work. The PC is to be told then.
    Alone(Instant),
    /// Nothing: it has been told, or need not be.
    Over,
}

/// The board's end of the line to the PC.
#[derive(Clone, Debug)]
pub struct Reception {
    beginning: Beginning,
    frames: FrameDecoder,
    pc: Transmitter,
    /// A frame that has come while slaves are busy.
    held: Option<Frame>,
    distributed: i64,
    outputs: VecDeque<Output>,
}

/// The quantities in the telemetry.
#[derive(Clone, Copy)]
enum Quantity {
    FramesDistributed,
    FrameHeld,
    SlavesBusy,
}

/// The events. Refusals come after these, one each.
#[derive(Clone, Copy)]
enum Event {
    Distributed,
    Held,
    AllDone,
    Reset,
    PcFramingError,
    PcOverrun,
    SlaveLost,
    SlaveStalled,
    SlaveEndOfTravel,
    SlaveGarbled,
    SlaveRestarted,
}

impl Event {
    const TEXTS: [&str; 11] = [
        "frame {} distributed",
        "frame held: slaves are busy",
        "all slaves done",
        "reset",
        "framing error on the line from the PC",
        "overrun on the line from the PC",
        "slave '{c}' does not answer",
        "slave '{c}' reports: stalled",
        "slave '{c}' reports: end of travel",
        "slave '{c}' reports: sub-frame garbled",
        "slave '{c}' reports: restarted",
    ];

    const fn of(fault: Fault) -> Self {
        match fault {
            Fault::NoAnswer => Self::SlaveLost,
            Fault::Stalled => Self::SlaveStalled,
            Fault::EndOfTravel => Self::SlaveEndOfTravel,
            Fault::Garbled => Self::SlaveGarbled,
            Fault::Restarted => Self::SlaveRestarted,
        }
    }
}

impl Reception {
    /// The bit of `slaves_busy` that is a slave's is its place in [`Slave::ALL`].
    pub const BUSY: u8 = Quantity::SlavesBusy as u8;
    /// How many events it has. A board's own come after them.
    pub const EVENTS: u8 = (Event::TEXTS.len() + Refusal::ALL.len()) as u8;

    /// The quantities in its telemetry. A board's own come after them.
    pub fn signals() -> Vec<Signal> {
        let state = |name| Signal::new(name, 0).with_role(Role::State);
        vec![Signal::new("frames_distributed", 0), state("frame_held"), state("slaves_busy")]
    }

    /// The texts of its events.
    pub fn events() -> Vec<String> {
        let refusals = Refusal::ALL.iter().map(|refusal| format!("frame refused: {refusal}"));
        Event::TEXTS.map(str::to_owned).into_iter().chain(refusals).collect()
    }

    /// The reception of a board that has just started.
    pub fn new(clock: Clock, beginning: Beginning) -> Self {
        Self {
            beginning,
            frames: FrameDecoder::new(clock),
            pc: Transmitter::hardware(RATE, clock),
            held: None,
            distributed: 0,
            outputs: VecDeque::new(),
        }
    }

    /// The firmware restarts.
    pub fn restart(&mut self, clock: Clock, beginning: Beginning) {
        let outputs = core::mem::take(&mut self.outputs);
        *self = Self { outputs, ..Self::new(clock, beginning) };
        self.event(Event::Reset, 0);
        for quantity in [Quantity::FramesDistributed, Quantity::FrameHeld, Quantity::SlavesBusy] {
            self.telemetry(quantity, 0);
        }
    }

    /// Counts in `clock` from now on.
    pub fn retune(&mut self, clock: Clock) {
        self.frames.retune(clock);
        self.pc.retune(RATE, clock);
    }

    /// Puts something that the board does after what it has done already.
    pub fn put(&mut self, output: Output) {
        self.outputs.push_back(output);
    }

    /// The next thing that the board does.
    pub fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn event(&mut self, event: Event, value: i64) {
        self.put(Output::Event { event: event as u8, value });
    }

    fn telemetry(&mut self, quantity: Quantity, value: i64) {
        self.put(Output::Telemetry { signal: quantity as u8, value });
    }

    fn reply(&mut self, reply: Reply) {
        reply.emit().into_iter().for_each(|byte| self.pc.push(byte));
    }

    fn refuse(&mut self, refusal: Refusal) {
        let place = Refusal::ALL.iter().position(|other| *other == refusal).unwrap_or_default();
        self.put(Output::Event { event: (Event::TEXTS.len() + place) as u8, value: 0 });
        self.reply(Reply::Nak(refusal));
    }

    fn is_busy(&self, slaves: &impl Slaves) -> bool {
        matches!(self.beginning, Beginning::Alone(_)) || slaves.are_busy()
    }

    /// A character has come from the PC.
    pub fn hear(&mut self, now: Instant, character: Character, slaves: &impl Slaves) -> Option<Order> {
        if character.framing_error {
            self.event(Event::PcFramingError, i64::from(character.byte));
        }
        if character.overrun {
            self.event(Event::PcOverrun, i64::from(character.byte));
        }
        match self.frames.push(now, character)? {
            Ok(bytes) => self.receive(bytes, slaves),
            Err(refusal) => {
                self.refuse(refusal);
                None
            }
        }
    }

    /// The paper's rule: if a process is running in any stage, the sending is delayed until all have finished, and the
    /// PC is informed (§3).
    fn receive(&mut self, bytes: [u8; Frame::LENGTH], slaves: &impl Slaves) -> Option<Order> {
        match Frame::parse(bytes) {
            Err(refusal) => self.refuse(refusal),
            Ok(_) if self.held.is_some() => self.refuse(Refusal::Overrun),
            Ok(frame) if self.is_busy(slaves) => {
                self.held = Some(frame);
                self.event(Event::Held, 0);
                self.telemetry(Quantity::FrameHeld, 1);
                self.frames.hold(true);
                self.reply(Reply::Xoff);
            }
            Ok(frame) => {
                let Some(slave) = slaves.lost_for(&frame) else { return Some(Order::Start(frame)) };
                self.refuse(Refusal::Faulted);
                return Some(Order::Enquire(slave));
            }
        }
        None
    }

    /// Every slave has its sub-frame.
    pub fn distributed(&mut self) {
        self.distributed += 1;
        self.event(Event::Distributed, self.distributed);
        self.telemetry(Quantity::FramesDistributed, self.distributed);
        self.reply(Reply::Ack);
    }

    /// A slave is found at work by a board that has just started: so it has not started with the machine.
    pub fn found_at_work(&mut self, now: Instant) {
        if self.beginning == Beginning::WithTheMachine {
            self.confess(now);
        }
    }

    /// Tells the PC that the board has restarted amid the machine's work. What was held is lost, and whether the PC
    /// is held is not known: it is taken to be, so that its silence counts from the `XON`.
    fn confess(&mut self, now: Instant) {
        self.reply(Reply::Can(Party::Master, Fault::Restarted));
        self.frames.hold(true);
        self.frames.stop(now);
        self.give_up(now);
    }

    /// A slave has failed. The PC has its answer to the frame, if one was being distributed.
    pub fn fail(&mut self, now: Instant, slave: Slave, fault: Fault) {
        self.event(Event::of(fault), i64::from(slave.letter()));
        self.reply(Reply::Can(slave.into(), fault));
        self.give_up(now);
    }

    /// What was held is not executed, and nothing more is accepted until the PC's line has been silent: with one frame
    /// missing, the relative frames that follow would turn a different part.
    fn give_up(&mut self, now: Instant) {
        self.beginning = Beginning::Over;
        if self.held.take().is_some() {
            self.telemetry(Quantity::FrameHeld, 0);
        }
        self.frames.abandon(now);
    }

    /// A slave is no longer busy. If none is, the PC may go on, and what was held is to be executed.
    pub fn check_done(&mut self, slaves: &impl Slaves) -> Option<Frame> {
        if self.is_busy(slaves) {
            return None;
        }
        let beginning = core::mem::replace(&mut self.beginning, Beginning::Over);
        if beginning == Beginning::WithTheMachine && self.held.is_none() {
            return None;
        }
        self.event(Event::AllDone, 0);
        self.reply(Reply::Xon);
        self.frames.hold(false);
        let held = self.held.take()?;
        self.telemetry(Quantity::FrameHeld, 0);
        Some(held)
    }

    /// Tells who is busy.
    pub fn report_busy(&mut self, slaves: &impl Slaves) {
        let mask = slaves.busy().iter().rev().fold(0, |mask, busy| mask << 1 | i64::from(*busy));
        self.telemetry(Quantity::SlavesBusy, mask);
    }

    /// A deadline is due. Gives a frame that is to be executed.
    pub fn handle_timeout(&mut self, now: Instant, slaves: &impl Slaves) -> Option<Frame> {
        let mut next = None;
        if matches!(self.beginning, Beginning::Alone(at) if at <= now) {
            self.confess(now);
            next = self.check_done(slaves);
        }
        if let Some(refusal) = self.frames.handle_timeout(now) {
            self.refuse(refusal);
        }
        next
    }

    /// Loads the shift register, if it is free.
    pub fn load(&mut self, now: Instant) {
        let Some(loaded) = self.pc.load(now) else { return };
        match loaded.byte {
            XOFF => self.frames.stop(now),
            XON => self.frames.go_on(now),
            _ => {}
        }
        self.put(Output::Character { port: PC, edges: loaded.edges, end: loaded.end });
    }

    /// When it has something to do, but for the PC's [silence](Self::silence).
    pub fn poll_timeout(&self) -> Option<Instant> {
        let beginning = match self.beginning {
            Beginning::Alone(at) => Some(at),
            Beginning::WithTheMachine | Beginning::Over => None,
        };
        self.pc.poll_timeout().into_iter().chain(beginning).min()
    }

    /// When it concludes something from the PC's silence.
    pub fn silence(&self) -> Option<Instant> {
        self.frames.poll_timeout()
    }
}
