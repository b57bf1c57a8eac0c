//! The servo stand's board: an SAB80C535 that follows a program of increments with a position loop, and tells the PC of
//! the following error.
//!
//! Lab sheet "Napęd pozycjonujący liniowy z silnikiem prądu stałego" (Wrocław, exercise 2a). What the sheet leaves open
//! is marked "(Ours.)"; what is said on the line, and what goes wrong on it, is told in [`torno_protocol::servo`].
//!
//! # The loop
//!
//! Every 5 ms: the set point takes an increment dx, e is the set point less the count, and the drive is u = (Kx·e +
//! Kv·dx)/16, rounded to the nearest, up to ±127. Kx is the sheet's "współczynnik proporcjonalności"; that Kv is a
//! feed-forward is ours: the sheet does not say what it is, and the controller holds dx and has no tachometer.
//!
//! # The carriage never runs away
//!
//! - At power-on and after a reset the loop is open, the drive off. `R` closes it where the axis stands.
//! - A program ends where its increments end; then the loop holds the axis. So does `S`, at the set point as it is.
//! - The set point never leaves the travel, 0 to 425 mm from where the firmware's 0 is. An increment that would take it
//!   out ends the run there, and the loop holds the axis.
//! - A hard stop at either side, 1 mm beyond, closes a switch. Driven into it (the firmware's 0 is elsewhere, the
//!   encoder has lost counts), the firmware gives up: the loop is open, the drive off.
//! - It gives up, too, if the following error gets larger than 32 mm: the motor is blocked, Kx is 0, or the encoder is
//!   dead.
//!
//! A run that ends early shows on the line as telemetry that stops; why, on the LED "fault". (All of this ours.)

use std::collections::VecDeque;
use std::sync::Arc;

use torno_protocol::board::{
    Board, Capability, Deadline, Description, Input, Motor, MotorStimulus, Output, Role, Signal, Stimulus,
};
use torno_protocol::clock::Clock;
use torno_protocol::servo::{Command, CommandDecoder, Flaw, PRESENT, RATE, Received, telemetry};
use torno_protocol::time::Instant;
use torno_protocol::uart::{Receiver, Transmitter};

use crate::encoder::Encoder;
use crate::machine::{ONLY_MOTOR, quantity};
use crate::plant::{Axis, Plant, PositionMotor};
use crate::schedule::Schedule;
use crate::settings::{KvOn, ServoController, ServoSettings};
use crate::telemetry::Telemetry;

/// The gains count in sixteenths. (Ours.)
const GAIN: i64 = 16;

/// How many quantities telemetry shows.
const QUANTITIES: usize = 11;

/// The events.
#[derive(Clone, Copy, Debug)]
enum Event {
    Taken,
    Begins,
    Over,
    Stopped,
    EndOfTravel,
    HardStop,
    ErrorTooLarge,
    Homed,
    Reset,
    Dropped,
    NoProgram,
    NoCommand,
    CommandCutShort,
    DownloadCutShort,
    DownloadTooLong,
    LineError,
}

impl Event {
    const TEXTS: [&str; 16] = [
        "program of {} increments taken",
        "run begins",
        "run over after {} increments",
        "run stopped after {} increments",
        "end of travel after {} increments",
        "gives up: driven into a hard stop",
        "gives up: following error of {} counts",
        "homed {} counts from the 0 before",
        "reset",
        "dropped during motion: '{c}'",
        "there is no program to run",
        "no command: {}",
        "a command is cut short",
        "a download is cut short",
        "a download goes on behind its end",
        "line error",
    ];
}

/// The servo stand's board.
#[derive(Clone, Debug)]
pub struct Servo {
    controller: ServoController,
    clock: Clock,
    commands: CommandDecoder,
    transmitter: Transmitter,
    schedule: Schedule,
    /// Its encoder is on the screw.
    axis: Axis,
    /// Where the carriage was by the true count when the firmware's 0 was set.
    zero: i64,
    /// The fullest drive, in LSB.
    full: i64,
    /// The end of the travel, in counts.
    travel: i64,
    firmware: Firmware,
    now: Instant,
    telemetry: Telemetry<QUANTITIES>,
    outputs: VecDeque<Output>,
}

/// Everything that a reset loses.
#[derive(Clone, Debug)]
struct Firmware {
    kx: u8,
    kv: u8,
    program: Arc<[i8]>,
    /// The next increment of the run under way.
    run: Option<usize>,
    /// The loop is closed.
    holding: bool,
    set_point: i64,
    count: i64,
    /// The counts since the tick before.
    moved: i64,
    drive: i64,
    faulted: bool,
    /// The drive of the service mode; 0 without it.
    service: i64,
}

impl Firmware {
    fn new(controller: &ServoController, count: i64) -> Self {
        Self {
            kx: controller.kx,
            kv: controller.kv,
            program: Arc::from([]),
            run: None,
            holding: false,
            set_point: count,
            count,
            moved: 0,
            drive: 0,
            faulted: false,
            service: 0,
        }
    }

    const fn error(&self) -> i64 {
        self.set_point - self.count
    }

    /// u = (Kx·e + Kv·dx)/16, to the nearest.
    fn law(&self, dx: i64, kv_on: KvOn, full: i64) -> i64 {
        let (kx, kv) = (i64::from(self.kx), i64::from(self.kv));
        let of_kv = match kv_on {
            KvOn::SetPoint => kv * dx,
            KvOn::Position => -kv * self.moved,
        };
        (kx * self.error() + of_kv + GAIN / 2).div_euclid(GAIN).clamp(-full, full)
    }

    /// Opens the loop. The set point is where the axis is.
    const fn let_go(&mut self) {
        self.run = None;
        self.holding = false;
        self.drive = 0;
        self.service = 0;
        self.set_point = self.count;
    }
}

impl Servo {
    /// The board as at power-on: the carriage stands at the beginning of its travel.
    pub fn new(settings: &ServoSettings, clock: Clock) -> Self {
        let ServoSettings { plant, drive, controller, .. } = settings;
        let full = settings.full_counts_per_s();
        let travel = settings.counts(plant.travel_mm).floor();
        let end = travel / 2.0 + settings.counts(plant.overtravel_mm);
        // Whole counts, so that the sensor is in the middle of a slot.
        let start = -(travel / 2.0).floor();
        let motor = PositionMotor::new(plant.tau_s, full, end)
            .with_load(plant.friction, plant.load_torque, drive.supply)
            .with_backlash(settings.counts(plant.backlash_mm))
            .standing_at(start);
        let axis = Axis::new(motor, Encoder::new(1.0), full, f64::from(drive.full)).with_dead_time(plant.dead_ms);
        let mut servo = Self {
            controller: controller.clone(),
            clock,
            commands: CommandDecoder::new(clock),
            transmitter: Transmitter::hardware(RATE, clock),
            schedule: Schedule::new(controller.timing(), clock),
            zero: axis.carriage(),
            axis,
            full: i64::from(drive.full),
            travel: travel as i64,
            firmware: Firmware::new(controller, 0),
            now: Instant::START,
            telemetry: Telemetry::new([0; QUANTITIES]),
            outputs: VecDeque::new(),
        };
        servo.telemetry = Telemetry::new(servo.values());
        // A load may move the axis that no one drives.
        servo.run_unless_at_rest(Instant::START);
        servo
    }

    /// In the order of [`Servo::values`].
    fn signals(&self) -> Vec<Signal> {
        let initial = Firmware::new(&self.controller, 0);
        let led = |name| Signal::new(name, 0).with_role(Role::State);
        vec![
            quantity("position_counts", Role::Position, "counts"),
            quantity("set_point_counts", Role::SetPoint, "counts"),
            quantity("error_counts", Role::Error, "counts"),
            quantity("drive", Role::Drive, "LSB"),
            quantity("carriage_offset_counts", Role::Offset, "counts"),
            Signal::new("kx", i64::from(initial.kx)),
            Signal::new("kv", i64::from(initial.kv)),
            Signal::new("program_increments", 0).with_unit("increments"),
            led("led_program"),
            led("led_running"),
            led("led_fault"),
        ]
    }

    fn values(&self) -> [i64; QUANTITIES] {
        let firmware = &self.firmware;
        let carriage = self.axis.carriage() - self.zero;
        [
            firmware.count,
            firmware.set_point,
            firmware.error(),
            firmware.drive,
            carriage.saturating_sub(firmware.count),
            i64::from(firmware.kx),
            i64::from(firmware.kv),
            firmware.program.len() as i64,
            i64::from(!firmware.program.is_empty()),
            i64::from(firmware.run.is_some()),
            i64::from(firmware.faulted),
        ]
    }

    fn tell(&mut self, event: Event, value: i64) {
        self.outputs.push_back(Output::Event { event: event as u8, value });
    }

    fn hear(&mut self, now: Instant, heard: Received) {
        match heard {
            Ok(Command::Stop) => {
                if let Some(done) = self.firmware.run.take() {
                    self.tell(Event::Stopped, done as i64);
                }
            }
            Ok(command) if self.firmware.run.is_some() => {
                let letter = command.emit().first().copied().unwrap_or_default();
                self.tell(Event::Dropped, i64::from(letter));
            }
            Ok(command) => self.carry_out(now, command),
            Err(flaw) => self.complain(flaw),
        }
    }

    fn carry_out(&mut self, now: Instant, command: Command) {
        match command {
            Command::Link => self.transmitter.push(PRESENT),
            Command::SetKx(value) => self.firmware.kx = value,
            Command::GetKx => self.transmitter.push(self.firmware.kx),
            Command::SetKv(value) => self.firmware.kv = value,
            Command::GetKv => self.transmitter.push(self.firmware.kv),
            Command::Download(increments) => {
                self.tell(Event::Taken, increments.len() as i64);
                self.firmware.program = Arc::from(increments);
            }
            Command::Run => self.begin(now),
            Command::Stop => {}
            Command::Home => self.home(now),
        }
        self.run_unless_at_rest(now);
    }

    fn complain(&mut self, flaw: Flaw) {
        let (event, value, of_download) = match flaw {
            Flaw::Unknown(byte) => (Event::NoCommand, byte, false),
            Flaw::CutShort(of_download) if of_download => (Event::DownloadCutShort, 0, true),
            Flaw::CutShort(_) => (Event::CommandCutShort, 0, false),
            Flaw::Overlong => (Event::DownloadTooLong, 0, true),
            Flaw::LineError(of_download) => (Event::LineError, 0, of_download),
        };
        self.tell(event, i64::from(value));
        if of_download && self.firmware.run.is_none() {
            self.firmware.program = Arc::from([]);
        }
    }

    fn begin(&mut self, now: Instant) {
        if self.firmware.program.is_empty() {
            return self.tell(Event::NoProgram, 0);
        }
        self.count(now);
        if !self.firmware.holding {
            self.firmware.set_point = self.firmware.count;
        }
        self.firmware.faulted = false;
        self.firmware.holding = true;
        self.firmware.run = Some(0);
        self.schedule.start(now);
        self.tell(Event::Begins, 0);
    }

    fn home(&mut self, now: Instant) {
        self.count(now);
        let before = self.firmware.count;
        self.restart_count(now);
        self.firmware.count = 0;
        self.firmware.set_point = 0;
        self.tell(Event::Homed, before);
    }

    /// The firmware's 0 is where the axis stands.
    fn restart_count(&mut self, now: Instant) {
        self.axis.restart(now);
        self.zero = self.axis.carriage();
    }

    /// What the firmware's counter shows.
    fn count(&mut self, now: Instant) {
        let count = self.axis.advance(now);
        self.firmware.moved = count - self.firmware.count;
        self.firmware.count = count;
    }

    fn drive(&mut self, drive: i64) {
        self.firmware.drive = drive;
        self.axis.drive(drive);
    }

    fn tick(&mut self, now: Instant) {
        self.count(now);
        if self.firmware.service != 0 {
            return self.drive(self.firmware.service);
        }
        let dx = self.next_increment();
        if !self.firmware.holding {
            self.firmware.set_point = self.firmware.count;
            return self.drive(0);
        }
        let drive = self.firmware.law(dx, self.controller.kv_on, self.full);
        let hard_stop = self.axis.end_stop();
        if hard_stop != 0 && hard_stop == drive.signum() {
            return self.give_up(Event::HardStop, 0);
        }
        let error = self.firmware.error();
        if error.abs() > i64::from(self.controller.error_max_counts) {
            return self.give_up(Event::ErrorTooLarge, error);
        }
        self.drive(drive);
    }

    /// Moves the set point by the program's next increment, and tells the PC of the following error.
    fn next_increment(&mut self) -> i64 {
        let Some(place) = self.firmware.run else { return 0 };
        let Some(dx) = self.firmware.program.get(place).map(|dx| i64::from(*dx)) else { return 0 };
        let to = self.firmware.set_point + dx;
        // It may be out already, where the axis has been put down; then it may come back.
        let leaves = (to < 0 && dx < 0) || (to > self.travel && dx > 0);
        if leaves {
            self.firmware.run = None;
            self.tell(Event::EndOfTravel, place as i64);
            return 0;
        }
        self.firmware.set_point = to;
        self.transmitter.push(telemetry(self.firmware.error()));
        let over = place + 1 == self.firmware.program.len();
        self.firmware.run = (!over).then_some(place + 1);
        if over {
            self.tell(Event::Over, place as i64 + 1);
        }
        dx
    }

    fn give_up(&mut self, event: Event, value: i64) {
        self.tell(event, value);
        self.firmware.let_go();
        self.firmware.faulted = true;
        self.drive(0);
    }

    fn restart(&mut self, now: Instant) {
        self.count(now);
        self.firmware = Firmware::new(&self.controller, self.firmware.count);
        self.commands = CommandDecoder::new(self.clock);
        self.transmitter = Transmitter::hardware(RATE, self.clock);
        self.drive(0);
        self.outputs.push_back(Output::Cut { port: 0 });
        self.tell(Event::Reset, 0);
        self.run_unless_at_rest(now);
    }

    fn stimulus(&mut self, now: Instant, stimulus: &Stimulus) {
        match stimulus {
            Stimulus::Motor { motor: 0, what } => {
                self.axis.disturb(now, what);
                if let MotorStimulus::Drive(per_mille) = what {
                    self.firmware.let_go();
                    self.firmware.service = self.axis.service(*per_mille);
                    self.drive(self.firmware.service);
                }
            }
            Stimulus::Reset => self.restart(now),
            Stimulus::Power(_) => {
                self.restart_count(now);
                self.restart(now);
            }
            Stimulus::Clock(clock) => {
                self.clock = *clock;
                self.commands.retune(*clock);
                self.transmitter.retune(RATE, *clock);
                self.schedule.retune(now, *clock);
            }
            _ => {}
        }
        self.run_unless_at_rest(now);
    }

    fn run_unless_at_rest(&mut self, now: Instant) {
        if !self.is_at_rest() {
            self.schedule.start(now);
        }
    }

    /// Left alone, further ticks would change nothing.
    fn is_at_rest(&self) -> bool {
        let firmware = &self.firmware;
        let drives = firmware.drive != 0 || firmware.service != 0;
        let would_drive = firmware.holding && firmware.law(0, KvOn::SetPoint, self.full) != 0;
        let coasts = self.axis.leaves(firmware.count);
        firmware.run.is_none() && !drives && !would_drive && !coasts
    }
}

impl Board for Servo {
    fn description(&self) -> Description {
        Description {
            ports: vec!["pc".to_owned()],
            signals: self.signals(),
            events: Event::TEXTS.map(str::to_owned).to_vec(),
            waits: Vec::new(),
            capabilities: vec![Capability::Reset],
            motors: vec![Motor { name: ONLY_MOTOR.to_owned(), capabilities: Axis::CAPABILITIES.to_vec() }],
            pins: Vec::new(),
        }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(RATE, self.clock)]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        self.now = now;
        match input {
            Input::Character { character, .. } => {
                // A silence that ends at this instant was one.
                let silence = self.commands.handle_timeout(now);
                let heard = silence.into_iter().chain(self.commands.push(now, character));
                heard.for_each(|heard| self.hear(now, heard));
            }
            Input::Stimulus(stimulus) => self.stimulus(now, &stimulus),
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.now = now;
        if let Some(heard) = self.commands.handle_timeout(now) {
            self.hear(now, heard);
        }
        if self.schedule.take(now) {
            self.tick(now);
            if self.is_at_rest() {
                self.schedule.stop();
            }
        }
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.telemetry.note(self.values());
        if let Some((signal, value)) = self.telemetry.poll() {
            return Some(Output::Telemetry { signal, value });
        }
        if let Some(output) = self.outputs.pop_front() {
            return Some(output);
        }
        let loaded = self.transmitter.load(self.now)?;
        Some(Output::Character { port: 0, edges: loaded.edges, end: loaded.end })
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let tick = self.schedule.poll_timeout().map(|at| Deadline { at, why: "tick" });
        let silence = self.silence().map(|at| Deadline { at, why: "silence on the PC's line" });
        let load = self.transmitter.poll_timeout().map(|at| Deadline { at, why: "the next character" });
        tick.into_iter().chain(silence).chain(load).min_by_key(|deadline| deadline.at)
    }

    fn silence(&self) -> Option<Instant> {
        self.commands.poll_timeout()
    }

    fn mute(&self) -> bool {
        self.firmware.run.is_none() && self.transmitter.poll_timeout().is_none()
    }
}
