//! Pace: how virtual time follows the wall clock. The only place that reads that clock to move time.

use std::fmt;
use std::io;
use std::str::FromStr;
use std::time::{Duration, Instant as WallInstant};

use torno_protocol::record::Silence;
use torno_protocol::time::{Instant, Span};

use crate::platform::Timer;
use torno_engine::Limit;

/// A host that is further behind than this, in wall time, does not try to catch up.
const BEHIND: Duration = Duration::from_secs(1);

/// Virtual seconds per wall second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// So many times real time.
    Times(f64),
    /// As fast as there is something to do.
    Max,
}

impl FromStr for Pace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "max" {
            return Ok(Self::Max);
        }
        match text.parse() {
            Ok(times) if (0.001..=100_000.0).contains(&times) => Ok(Self::Times(times)),
            _ => Err("expected 'max' or a number from 0.001 to 100000".to_owned()),
        }
    }
}

impl fmt::Display for Pace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Times(times) => write!(f, "{times}"),
            Self::Max => f.write_str("max"),
        }
    }
}

/// Holds virtual time back to the pace.
#[derive(Debug)]
pub struct Brake {
    pace: Pace,
    /// A wall instant and the virtual instant that it stands for. At [`Pace::Max`] there is one only while a board
    /// waits for the silence of the world outside.
    anchor: Option<(WallInstant, Instant)>,
    /// The silence that the anchor was dropped for, at [`Pace::Max`].
    silence: Option<Silence>,
    /// Time stands still here.
    paused: Option<Instant>,
    timer: Timer,
}

impl Brake {
    /// A brake that starts now.
    ///
    /// # Errors
    /// If the system refuses a timer.
    pub fn new(pace: Pace) -> io::Result<Self> {
        let mut brake = Self { pace, anchor: None, silence: None, paused: None, timer: Timer::new()? };
        brake.set_pace(pace, Instant::START);
        Ok(brake)
    }

    /// Sets another pace, from `now` on. A pause stays one.
    pub fn set_pace(&mut self, pace: Pace, now: Instant) {
        self.pace = pace;
        self.silence = None;
        self.anchor = match pace {
            Pace::Times(_) => Some((wall_now(), now)),
            Pace::Max => None,
        };
    }

    /// Lets time go as far as `at`, at once, and stand still there.
    pub fn pause(&mut self, at: Instant) {
        self.paused = Some(at);
    }

    /// Lets time go on at its pace, from `now` on.
    pub fn resume(&mut self, now: Instant) {
        self.paused = None;
        self.set_pace(self.pace, now);
    }

    /// Where time stands still, if it does.
    pub const fn paused(&self) -> Option<Instant> {
        self.paused
    }

    /// The pace.
    pub const fn pace(&self) -> Pace {
        self.pace
    }

    /// The virtual instant that the wall clock stands for, if time is held back.
    pub fn now(&self) -> Option<Instant> {
        if self.paused.is_some() {
            return self.paused;
        }
        let (wall, start) = self.anchor?;
        let elapsed = wall_now().duration_since(wall).as_nanos() as f64 * self.times();
        Some(start + Span::from_nanos(elapsed as u64))
    }

    /// How far time may go by now.
    pub fn limit(&self) -> Limit {
        if let Some(paused) = self.paused {
            return Limit::until(paused);
        }
        match (self.pace, self.now()) {
            (Pace::Max, now) => Limit { until: Instant::NEVER, silence: now.unwrap_or(Instant::START) },
            (Pace::Times(_), now) => Limit::until(now.unwrap_or(Instant::START)),
        }
    }

    /// At [`Pace::Max`]: the silence that a board waits for holds time back, as if `frontier` were still its beginning.
    /// Each silence is given all of its own time, however soon it follows on another.
    pub fn hold_for_silence(&mut self, silence: Option<Silence>, frontier: Instant) {
        if self.pace == Pace::Max && self.paused.is_none() && silence != self.silence {
            self.silence = silence;
            self.anchor = silence.map(|silence| (wall_now(), silence.from.min(frontier)));
        }
    }

    /// Time should have gone no further than `reached` by now. A host that is far behind starts again from there; says
    /// by how much wall time.
    pub fn reached(&mut self, reached: Instant) -> Option<Duration> {
        if self.paused.is_some() {
            return None;
        }
        let behind = Duration::from_secs_f64(self.now()?.since(reached).as_secs_f64() / self.times());
        if behind <= BEHIND {
            return None;
        }
        self.anchor = Some((wall_now(), reached));
        Some(behind)
    }

    /// How long it takes until the wall clock stands for `instant`; for ever, if time is not held back or stands
    /// still.
    pub fn wall_until(&self, instant: Instant) -> Duration {
        match self.now() {
            Some(now) if !instant.is_never() && self.paused.is_none() => {
                Duration::try_from_secs_f64(instant.since(now).as_secs_f64() / self.times()).unwrap_or(Duration::MAX)
            }
            _ => Duration::MAX,
        }
    }

    /// Waits until the wall clock stands for a virtual instant after `instant`; for ever, if time is not held back or
    /// stands still, or `instant` is never. Cancel-safe.
    ///
    /// # Errors
    /// If the system refuses the timer.
    pub async fn wait_past(&self, instant: Instant) -> io::Result<()> {
        let Some(now) = self.now().filter(|_| !instant.is_never() && self.paused.is_none()) else {
            return std::future::pending().await;
        };
        let wall = (instant.next().since(now).as_nanos() as f64 / self.times()) as u64;
        self.timer.wait(Duration::from_nanos(wall.saturating_add(1))).await
    }

    /// The virtual time that goes by in so much wall time; none, if time is not held back or stands still.
    pub fn span_of(&self, wall: Duration) -> Option<Span> {
        match (self.pace, self.paused) {
            (Pace::Times(times), None) => Some(Span::from_nanos((wall.as_nanos() as f64 * times) as u64)),
            _ => None,
        }
    }

    fn times(&self) -> f64 {
        match self.pace {
            Pace::Times(times) => times,
            Pace::Max => 1.0,
        }
    }
}

/// Tells when so much wall time has passed, to those who look by.
#[derive(Debug)]
pub struct Lapse {
    begun: WallInstant,
    lasts: Duration,
}

impl Lapse {
    /// One that begins now.
    pub fn begin(lasts: Duration) -> Self {
        Self { begun: wall_now(), lasts }
    }

    /// Whether it will be over when `wait` has passed; if so, another begins now.
    pub fn is_over(&mut self, wait: Duration) -> bool {
        let now = wall_now();
        let over = now.duration_since(self.begun).saturating_add(wait) >= self.lasts;
        if over {
            self.begun = now;
        }
        over
    }
}

#[expect(clippy::disallowed_methods, reason = "this is where the wall clock is read")]
fn wall_now() -> WallInstant {
    WallInstant::now()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pace_is_a_number_or_max() {
        assert_eq!("max".parse(), Ok(Pace::Max));
        assert_eq!("10".parse(), Ok(Pace::Times(10.0)));
        for wrong in ["", "0", "-1", "fast", "nan", "inf", "1e9"] {
            assert!(wrong.parse::<Pace>().is_err(), "{wrong}");
        }
    }

    #[tokio::test]
    async fn waits_until_the_instant_is_past() {
        let brake = Brake::new(Pace::Times(100.0)).unwrap();
        let instant = Instant::from_nanos(500_000_000);
        brake.wait_past(instant).await.unwrap();
        assert!(brake.now().unwrap() > instant);
    }

    #[tokio::test]
    async fn each_silence_is_given_its_own_time() {
        let at = |ms: u64| Instant::START + Span::from_millis(ms);
        let silence = |ms: u64| Some(Silence { from: at(ms), deadline: at(ms + 50) });
        let mut brake = Brake::new(Pace::Max).unwrap();
        assert_eq!(brake.limit(), Limit { until: Instant::NEVER, silence: Instant::START });
        brake.hold_for_silence(silence(10), at(11));
        let (wall, start) = brake.anchor.unwrap();
        brake.anchor = Some((wall - Duration::from_secs(5), start));
        brake.hold_for_silence(silence(10), at(12));
        assert!(brake.limit().silence > at(5_000), "the same silence goes on");
        brake.hold_for_silence(silence(20_000), at(20_001));
        assert_eq!(brake.anchor.unwrap().1, at(20_000), "all of it");
        brake.hold_for_silence(None, at(30_000));
        assert_eq!(brake.limit().silence, Instant::START);
    }

    #[tokio::test]
    async fn a_host_far_behind_starts_anew() {
        let mut brake = Brake::new(Pace::Times(1.0)).unwrap();
        let (wall, start) = brake.anchor.unwrap();
        brake.anchor = Some((wall - Duration::from_secs(5), start));
        assert!(brake.reached(Instant::START).is_some_and(|behind| behind >= Duration::from_secs(5)));
        assert!(brake.now().unwrap() < Instant::from_nanos(1_000_000_000));
        assert_eq!(brake.reached(Instant::START), None);
    }
}
