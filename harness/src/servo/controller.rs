//! The controller, as the PC program asks it and tells it over a line.

use std::time::Duration;

use torno_protocol::servo::{Command, GAP, INCREMENTS_MAX, PAUSE, PRESENT, shown};
use torno_protocol::time::Span;
use torno_servo::Unwrapped;

use super::line::{LineError, ServoLine};

/// How long an answer may take: a USB adapter holds bytes back for 16 ms, and a computer may be busy. (Ours.)
const PATIENCE: Duration = Duration::from_millis(500);
/// How long telemetry may be silent before the controller is asked whether it is still there. (Ours.)
const SILENCE: Duration = Duration::from_millis(500);
/// A computer's sleep may be short by as much. (Ours.)
const MARGIN: Duration = Duration::from_millis(20);
/// How often a controller that goes on sending is told to stop. (Ours.)
const STOPS: usize = 3;

/// One of the two gains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gain {
    /// The position gain.
    Kx,
    /// The feed-forward.
    Kv,
}

/// A tick of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// Which, from 1.
    pub tick: usize,
    /// The following error, in counts.
    pub error: i64,
    /// The same as one byte shows it.
    pub shown: i8,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunEnd {
    /// With the program.
    Completed,
    /// Before: the controller is there, and has ended it. Why, its LEDs say.
    Early,
    /// The PC has stopped it.
    Interrupted,
}

/// Why the controller did not do what it should.
#[derive(Debug, thiserror::Error)]
pub enum ControllerError {
    /// The line.
    #[error(transparent)]
    Line(#[from] LineError),
    /// It says nothing.
    #[error("no answer from the controller on {on}")]
    NoAnswer {
        /// The line.
        on: String,
    },
    /// It is none.
    #[error(
        "what is on {on} is no controller of the servo stand, or it is in motion: expected 63 ('c'), found {found}"
    )]
    Other {
        /// The line.
        on: String,
        /// The bytes that came.
        found: String,
    },
    /// It said something before and is silent now.
    #[error("the controller on {on} has fallen silent after {ticks} of {of} ticks")]
    Silent {
        /// The line.
        on: String,
        /// The ticks that it has told of.
        ticks: usize,
        /// The ticks of the program.
        of: usize,
    },
    /// A gain is another than was asked for.
    #[error("{gain:?} is {found} on {on}: expected {asked}, which was set")]
    Gain {
        /// The line.
        on: String,
        /// Which.
        gain: Gain,
        /// What was set.
        asked: u8,
        /// What it says.
        found: u8,
    },
    /// The download has not arrived.
    #[error("the program has not reached the controller on {on}: it does not answer behind it")]
    Download {
        /// The line.
        on: String,
    },
    /// A program that the controller cannot hold.
    #[error("the program has {found} increments: expected 1 to {INCREMENTS_MAX}")]
    Length {
        /// How many it has.
        found: usize,
    },
}

impl Gain {
    const fn get(self) -> Command {
        match self {
            Self::Kx => Command::GetKx,
            Self::Kv => Command::GetKv,
        }
    }

    const fn set(self, value: u8) -> Command {
        match self {
            Self::Kx => Command::SetKx(value),
            Self::Kv => Command::SetKv(value),
        }
    }
}

/// The controller on a line.
#[derive(Debug)]
pub struct Controller<L> {
    line: L,
}

impl<L: ServoLine> Controller<L> {
    /// One that has not been asked yet whether it is there.
    pub const fn on(line: L) -> Self {
        Self { line }
    }

    /// Asks whether it is there (§3: "sterownik połączony").
    ///
    /// # Errors
    /// [`ControllerError`]: the line is released.
    pub async fn connect(line: L) -> Result<Self, ControllerError> {
        let mut controller = Self::on(line);
        controller.check_link().await?;
        Ok(controller)
    }

    /// Asks whether it is still there.
    ///
    /// # Errors
    /// [`ControllerError::NoAnswer`] or [`ControllerError::Other`].
    pub async fn check_link(&mut self) -> Result<(), ControllerError> {
        // What has come unasked is no answer.
        self.line.receive(Duration::ZERO).await?;
        self.say(&Command::Link).await?;
        let on = self.line.name().to_owned();
        match self.line.receive(PATIENCE).await?[..] {
            [] => Err(ControllerError::NoAnswer { on }),
            [PRESENT] => Ok(()),
            ref other => {
                let shown: Vec<String> = other.iter().take(8).map(|byte| format!("{byte:02X}")).collect();
                Err(ControllerError::Other { on, found: shown.join(" ") })
            }
        }
    }

    /// The line.
    pub const fn line(&mut self) -> &mut L {
        &mut self.line
    }

    /// Lets the line go: another program can have the port.
    pub fn disconnect(self) -> L {
        self.line
    }

    async fn say(&mut self, command: &Command) -> Result<(), ControllerError> {
        Ok(self.line.send(&command.emit(), |_| {}).await?)
    }

    /// What a gain is, as the controller says.
    ///
    /// # Errors
    /// [`ControllerError::NoAnswer`].
    pub async fn gain(&mut self, gain: Gain) -> Result<u8, ControllerError> {
        self.say(&gain.get()).await?;
        let answer = self.line.receive(PATIENCE).await?;
        answer.last().copied().ok_or_else(|| ControllerError::NoAnswer { on: self.line.name().to_owned() })
    }

    /// Sets a gain, and asks the controller for it: what it says counts, not what was typed (§3.1).
    ///
    /// # Errors
    /// [`ControllerError::Gain`] if it says something else.
    pub async fn set_gain(&mut self, gain: Gain, value: u8) -> Result<u8, ControllerError> {
        self.say(&gain.set(value)).await?;
        // If the value is lost, the question must not be taken for it.
        self.line.rest(wall(GAP) + MARGIN).await?;
        match self.gain(gain).await? {
            found if found == value => Ok(found),
            found => Err(ControllerError::Gain { on: self.line.name().to_owned(), gain, asked: value, found }),
        }
    }

    /// The position is 0 from now on.
    ///
    /// # Errors
    /// [`ControllerError::Line`].
    pub async fn home(&mut self) -> Result<(), ControllerError> {
        self.say(&Command::Home).await
    }

    /// Hands it a program: at most [`INCREMENTS_MAX`] increments. `progress` hears how many bytes have gone, of how
    /// many.
    ///
    /// # Errors
    /// [`ControllerError::Download`] if it does not answer behind it.
    pub async fn download(
        &mut self,
        increments: &[i8],
        mut progress: impl FnMut(usize, usize),
    ) -> Result<(), ControllerError> {
        if increments.is_empty() || increments.len() > INCREMENTS_MAX {
            return Err(ControllerError::Length { found: increments.len() });
        }
        let bytes = Command::Download(increments.to_vec()).emit();
        let mut gone = 0;
        let all = bytes.len();
        self.line
            .send(&bytes, |more| {
                gone += more;
                progress(gone, all);
            })
            .await?;
        self.line.rest(wall(PAUSE) + MARGIN).await?;
        match self.check_link().await {
            Err(ControllerError::NoAnswer { on }) => Err(ControllerError::Download { on }),
            other => other,
        }
    }

    /// Runs the program that it holds, of so many increments. `heard` hears each tick, and says whether to go on.
    ///
    /// # Errors
    /// [`ControllerError::Silent`] if it falls silent and does not answer any more.
    pub async fn run(
        &mut self,
        increments: usize,
        mut heard: impl FnMut(Sample) -> bool,
    ) -> Result<RunEnd, ControllerError> {
        self.line.receive(Duration::ZERO).await?;
        self.say(&Command::Run).await?;
        let (mut tick, mut errors) = (0, Unwrapped::default());
        while tick < increments {
            let bytes = self.line.receive(SILENCE).await?;
            if bytes.is_empty() {
                return match self.check_link().await {
                    Ok(()) => Ok(RunEnd::Early),
                    Err(ControllerError::NoAnswer { on }) => {
                        Err(ControllerError::Silent { on, ticks: tick, of: increments })
                    }
                    Err(error) => Err(error),
                };
            }
            for byte in bytes.into_iter().take(increments - tick) {
                tick += 1;
                let shown = shown(byte);
                if !heard(Sample { tick, error: errors.push(shown), shown }) {
                    self.stop().await?;
                    return Ok(RunEnd::Interrupted);
                }
            }
        }
        Ok(RunEnd::Completed)
    }

    /// Stops a run; says so again while the controller goes on sending.
    ///
    /// # Errors
    /// [`ControllerError::Line`].
    pub async fn stop(&mut self) -> Result<(), ControllerError> {
        for _ in 0..STOPS {
            self.say(&Command::Stop).await?;
            self.line.receive(Duration::ZERO).await?;
            self.line.rest(MARGIN).await?;
            self.line.receive(Duration::ZERO).await?;
            if self.line.receive(MARGIN).await?.is_empty() {
                break;
            }
        }
        Ok(())
    }
}

/// Parts of a program that the controller can hold, cut where the set point rests if it does.
pub fn parts(increments: &[i8]) -> Vec<&[i8]> {
    let mut parts = Vec::new();
    let mut rest = increments;
    while rest.len() > INCREMENTS_MAX {
        let at_rest = rest[..INCREMENTS_MAX].windows(2).rposition(|pair| pair == [0, 0]);
        let (part, behind) = rest.split_at(at_rest.map_or(INCREMENTS_MAX, |place| place + 1));
        parts.push(part);
        rest = behind;
    }
    parts.push(rest);
    parts
}

fn wall(span: Span) -> Duration {
    Duration::from_nanos(span.as_nanos())
}
