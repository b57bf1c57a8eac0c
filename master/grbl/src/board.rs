//! The board: the controller between the PC's UART and the machine's.

use std::collections::VecDeque;

use torno_grbl::Abilities;
use torno_grbl::controller::Controller;
use torno_grbl::memory::Memory;
use torno_grbl::state::State;
use torno_protocol::board::{
    self, Capability, Deadline, Description, Input, Kept, Output, Pin, Role, Signal, Stimulus,
};
use torno_protocol::clock::{Clock, Rate};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::{Character, Receiver, Transmitter};

use crate::lathe::Lathe;
use crate::settings::GrblSettings;
use crate::wired::{EVENTS, Wired};

/// The PC's port.
const USB: u8 = 0;
/// The speed of the PC's line.
const USB_RATE: Rate = Rate::hz(115_200);
/// The setting that says what the EEPROM holds at the start.
const EEPROM: &str = "eeprom";
/// X and Z move; the main motor turns one way.
const ABILITIES: Abilities =
    Abilities { axes: [true, false, true, false], counterclockwise: false, single_homing: false, holds_slowly: true };

/// The events.
#[derive(Clone, Copy)]
enum Event {
    Lost,
    Early,
    LineError,
}

impl Event {
    const TEXTS: [&str; EVENTS as usize] =
        ["the receive buffer is full: {} is lost", "{} comes before the banner and is lost", "line error on port {}"];
}

/// The board in front of the lathe's master.
pub type Grbl = Board<Lathe>;

/// The board, with the machine that it is wired to.
#[derive(Clone, Debug)]
pub struct Board<M> {
    clock: Clock,
    boot: Span,
    /// It says who it is then, and hears nothing before.
    boots_until: Option<Instant>,
    controller: Controller<M>,
    usb: Transmitter,
    state: State,
    /// The instant of the last call.
    now: Instant,
    outputs: VecDeque<Output>,
}

impl Grbl {
    /// The board as at power-on. The settings must have been [checked](GrblSettings::check).
    pub fn new(settings: &GrblSettings, clock: Clock) -> Self {
        let boot = Span::from_millis(u64::from(settings.boot_ms));
        Self::wired(boot, settings.memory(), ABILITIES, Lathe::new(settings, clock), clock)
    }
}

impl<M: Wired> Board<M> {
    /// The board as at power-on, in front of a machine. The time from a reset to the banner is `boot`.
    pub fn wired(boot: Span, memory: Memory, abilities: Abilities, machine: M, clock: Clock) -> Self {
        Self {
            clock,
            boot,
            boots_until: Some(Instant::START + clock.span(boot)),
            controller: Controller::new(memory, abilities, machine),
            usb: Transmitter::hardware(USB_RATE, clock),
            state: State::Idle,
            now: Instant::START,
            outputs: VecDeque::new(),
        }
    }

    /// The controller.
    pub const fn controller(&self) -> &Controller<M> {
        &self.controller
    }

    fn restart(&mut self, now: Instant) {
        self.usb.clear();
        self.outputs.push_back(Output::Cut { port: USB });
        self.controller.machine_mut().restart(now);
        self.boots_until = Some(now + self.clock.span(self.boot));
    }

    fn event(&mut self, event: Event, value: u8) {
        self.outputs.push_back(Output::Event { event: event as u8, value: i64::from(value) });
    }

    fn hear(&mut self, now: Instant, port: u8, character: Character) {
        let Some(byte) = character.ok() else { return self.event(Event::LineError, port) };
        match (port, self.boots_until) {
            (USB, Some(_)) => self.event(Event::Early, byte),
            (USB, None) => {
                if !self.controller.receive(now, byte) {
                    self.event(Event::Lost, byte);
                }
            }
            _ => self.controller.machine_mut().hear(now, port, byte),
        }
    }

    /// One byte waits while another one is on the line.
    fn feed_usb(&mut self, now: Instant) {
        if self.boots_until.is_none()
            && self.usb.poll_timeout().is_none()
            && let Some(byte) = self.controller.poll_transmit(now)
        {
            self.usb.push(byte);
        }
    }

    /// Does what is due, and loads the transmitters.
    fn proceed(&mut self, now: Instant) {
        self.now = now;
        match self.boots_until {
            Some(until) if until > now => {}
            Some(_) => {
                self.boots_until = None;
                self.controller.power_on(now);
            }
            None => {
                self.controller.machine_mut().step(now);
                self.controller.run(now);
            }
        }
        self.feed_usb(now);
        if let Some(loaded) = self.usb.load(now) {
            self.outputs.push_back(Output::Character { port: USB, edges: loaded.edges, end: loaded.end });
        }
        while let Some(output) = self.controller.machine_mut().poll_output(now) {
            self.outputs.push_back(output);
        }
        self.feed_usb(now);
        let state = self.controller.state();
        if state != self.state {
            self.state = state;
            self.outputs.push_back(Output::Telemetry { signal: 0, value: state as i64 });
        }
    }
}

impl<M: Wired> board::Board for Board<M> {
    fn description(&self) -> Description {
        let mut description = Description {
            ports: vec!["usb".to_owned()],
            signals: vec![Signal::new("state", State::Idle as i64).with_role(Role::State)],
            events: Event::TEXTS.map(str::to_owned).to_vec(),
            capabilities: vec![Capability::Reset],
            ..Description::default()
        };
        self.controller.machine().describe(&mut description);
        description
    }

    fn receivers(&self) -> Vec<Receiver> {
        let mut receivers = vec![Receiver::hardware(USB_RATE, self.clock)];
        receivers.extend(self.controller.machine().receivers());
        receivers
    }

    fn handle_input(&mut self, now: Instant, input: Input) {
        match input {
            Input::Character { port, character } => self.hear(now, port, character),
            Input::Stimulus(Stimulus::Reset) => self.restart(now),
            Input::Stimulus(Stimulus::Power(on)) => {
                self.restart(now);
                self.controller.machine_mut().power(now, on);
            }
            Input::Stimulus(Stimulus::Clock(clock)) => {
                self.clock = clock;
                self.usb.retune(USB_RATE, clock);
                self.controller.machine_mut().retune(clock);
            }
            Input::Stimulus(Stimulus::Motor { motor, what }) => {
                self.controller.machine_mut().disturb(now, motor, what);
            }
            Input::Stimulus(_) => {}
        }
        self.proceed(now);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.proceed(now);
    }

    fn poll_output(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    fn poll_timeout(&self) -> Option<Deadline> {
        let at = |at: Option<Instant>, why| at.map(|at| Deadline { at, why });
        let all = [
            at(self.boots_until, "the banner"),
            at(self.controller.poll_timeout(), "a line goes on"),
            self.controller.machine().poll_timeout(self.now),
            at(self.usb.poll_timeout(), "the next character to the PC"),
        ];
        all.into_iter().flatten().min_by_key(|deadline| deadline.at)
    }

    /// Whoever has opened the port is to have the time to flush it before the banner comes.
    fn silence(&self) -> Option<Instant> {
        self.boots_until
    }

    fn quantities(&self, at: Instant) -> Vec<(u8, i64)> {
        self.controller.machine().quantities(at)
    }

    fn watch_pins(&mut self) {
        self.controller.machine_mut().watch_pins();
    }

    fn pins(&mut self, until: Instant) -> Vec<Pin> {
        self.controller.machine_mut().pins(until)
    }

    fn kept(&self) -> Option<Kept> {
        Some(Kept { setting: EEPROM.to_owned(), lines: self.controller.memory().lines() })
    }
}
