//! The board: the conversation with the PC on one side, the motors on the other.

use torno_master::{Beginning, Order, PC, Reception, START_UP, Slaves};
use torno_protocol::board::{Board, Capability, Deadline, Description, Input, Output, Pin, Signal, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{Fault, Frame, RATE, Slave};
use torno_protocol::time::Instant;
use torno_protocol::uart::{Character, Receiver};
use torno_slaves::{DepthTask, Machine, Progress, SpindleTask, Task, TransverseTask};

use crate::settings::DspicSettings;

/// The board.
///
/// It answers as the master does; what `slaves` are in its telemetry and its events are its own three laws. Each
/// samples in its own period.
#[derive(Clone, Debug)]
pub struct Dspic {
    clock: Clock,
    reception: Reception,
    tasks: Tasks,
}

/// The three laws with their motors.
#[derive(Clone, Debug)]
struct Tasks {
    spindle: SpindleTask,
    transverse: TransverseTask,
    depth: DepthTask,
    /// Those that are executing their sub-frame.
    busy: [bool; 3],
}

impl Tasks {
    fn all(&self) -> [&Task<dyn Machine>; 3] {
        [&self.spindle, &self.transverse, &self.depth]
    }

    fn all_mut(&mut self) -> [&mut Task<dyn Machine>; 3] {
        [&mut self.spindle, &mut self.transverse, &mut self.depth]
    }

    fn start(&mut self, now: Instant, frame: &Frame) {
        self.spindle.start(now, frame.spindle);
        self.transverse.start(now, frame.transverse);
        self.depth.start(now, frame.depth);
        self.busy = [true; 3];
    }
}

impl Slaves for Tasks {
    fn are_busy(&self) -> bool {
        self.busy.contains(&true)
    }

    fn busy(&self) -> [bool; 3] {
        self.busy
    }

    /// Whoever is on the same board answers.
    fn lost_for(&self, _: &Frame) -> Option<Slave> {
        None
    }
}

impl Dspic {
    /// The board as at power-on: the motors stand, the axes in mid-travel.
    pub fn new(settings: &DspicSettings, clock: Clock) -> Self {
        let tasks = Tasks {
            spindle: SpindleTask::new(&settings.spindle, clock),
            transverse: TransverseTask::new(&settings.transverse, clock),
            depth: DepthTask::new(&settings.depth, clock),
            busy: [false; 3],
        };
        // No one is there to be asked: whatever it begins with, it knows.
        Self { clock, reception: Reception::new(clock, Beginning::Over), tasks }
    }

    /// The firmware restarts. A PC that was held, or whose frame was being executed, must be told.
    fn restart(&mut self, beginning: Beginning) {
        self.tasks.busy = [false; 3];
        self.reception.put(Output::Cut { port: PC });
        self.reception.restart(self.clock, beginning);
    }

    fn stimulus(&mut self, now: Instant, stimulus: &Stimulus) {
        match stimulus {
            Stimulus::Motor { motor, what } => {
                if let Some(task) = self.tasks.all_mut().get_mut(usize::from(*motor)) {
                    task.disturb(now, what);
                }
            }
            Stimulus::Reset => {
                self.tasks.all_mut().into_iter().for_each(|task| task.reset(now));
                self.restart(Beginning::Alone(now + self.clock.span(START_UP)));
            }
            Stimulus::Power(_) => {
                self.tasks.all_mut().into_iter().for_each(|task| task.power(now));
                self.restart(Beginning::Over);
            }
            Stimulus::Clock(clock) => {
                self.clock = *clock;
                self.tasks.all_mut().into_iter().for_each(|task| task.retune(now, *clock));
                self.reception.retune(*clock);
            }
            _ => {}
        }
    }

    fn hear(&mut self, now: Instant, character: Character) {
        match self.reception.hear(now, character, &self.tasks) {
            Some(Order::Start(frame)) => self.execute(now, &frame),
            // It has none that do not answer.
            Some(Order::Enquire(_)) | None => {}
        }
    }

    fn execute(&mut self, now: Instant, frame: &Frame) {
        self.tasks.start(now, frame);
        self.reception.report_busy(&self.tasks);
        self.reception.distributed();
    }

    fn sample(&mut self, now: Instant) {
        let busy = self.tasks.busy;
        let tasks = self.tasks.all_mut().into_iter().zip(busy);
        let progress: Vec<Progress> = tasks.map(|(task, busy)| task.sample(now, busy)).collect();
        if progress.iter().all(|progress| *progress == Progress::Going) {
            return;
        }
        for (busy, progress) in self.tasks.busy.iter_mut().zip(&progress) {
            *busy &= *progress == Progress::Going;
        }
        self.reception.report_busy(&self.tasks);
        let failures = Slave::ALL.into_iter().zip(progress).filter_map(|(slave, progress)| match progress {
            Progress::Failed(fault) => Some((slave, fault)),
            Progress::Going | Progress::Done => None,
        });
        failures.for_each(|(slave, fault): (Slave, Fault)| self.reception.fail(now, slave, fault));
        if let Some(frame) = self.reception.check_done(&self.tasks) {
            self.execute(now, &frame);
        }
    }

    fn poll_telemetry(&mut self) -> Option<Output> {
        let mut first = Reception::signals().len() as u8;
        for task in self.tasks.all_mut() {
            if let Some((signal, value)) = task.poll_telemetry() {
                return Some(Output::Telemetry { signal: first + signal, value });
            }
            first += task.signals().len() as u8;
        }
        None
    }
}

impl Board for Dspic {
    fn description(&self) -> Description {
        let named = || Slave::ALL.into_iter().map(Slave::name).zip(self.tasks.all());
        let signals = named().zip(0..).flat_map(|((name, task), motor)| {
            let named = move |signal: Signal| Signal { name: format!("{name}_{}", signal.name), ..signal };
            task.signals().into_iter().map(move |signal| named(signal).of_motor(motor))
        });
        Description {
            ports: vec!["pc".to_owned()],
            signals: Reception::signals().into_iter().chain(signals).collect(),
            events: Reception::events(),
            waits: Vec::new(),
            capabilities: vec![Capability::Reset],
            motors: named().map(|(name, task)| task.motor(name)).collect(),
            pins: Vec::new(),
        }
    }

    fn receivers(&self) -> Vec<Receiver> {
        vec![Receiver::hardware(RATE, self.clock)]
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        match input {
            Input::Character { character, .. } => self.hear(now, character),
            Input::Stimulus(stimulus) => self.stimulus(now, &stimulus),
        }
        self.reception.load(now);
    }

    fn handle_timeout(&mut self, now: Instant) {
        if let Some(frame) = self.reception.handle_timeout(now, &self.tasks) {
            self.execute(now, &frame);
        }
        self.sample(now);
        self.reception.load(now);
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.poll_telemetry().or_else(|| self.reception.poll_output())
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let samples = self.tasks.all().into_iter().filter_map(|task| task.poll_timeout());
        let sample = samples.min().map(|at| Deadline { at, why: "sample" });
        let own = self.reception.poll_timeout().map(|at| Deadline { at, why: "transmitter free" });
        let silence = self.silence().map(|at| Deadline { at, why: "silence on the PC's line" });
        sample.into_iter().chain(own).chain(silence).min_by_key(|deadline| deadline.at)
    }

    fn silence(&self) -> Option<Instant> {
        self.reception.silence()
    }

    fn mute(&self) -> bool {
        let talks = self.reception.poll_timeout().is_some() || self.silence().is_some();
        !talks && !self.tasks.are_busy() && !self.tasks.all().into_iter().any(|task| task.is_on_watch())
    }

    fn watch_pins(&mut self) {
        let clock = self.clock;
        self.tasks.all_mut().into_iter().for_each(|task| task.watch_pins(clock));
    }

    fn pins(&mut self, until: Instant) -> Vec<Pin> {
        let tasks = Slave::ALL.into_iter().map(Slave::name).zip(self.tasks.all_mut());
        let named = |name: &str, pin: Pin| Pin { name: format!("{name}_{}", pin.name), ..pin };
        tasks.flat_map(|(name, task)| task.pins(until).into_iter().map(move |pin| named(name, pin))).collect()
    }
}
