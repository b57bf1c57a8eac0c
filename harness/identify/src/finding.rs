//! What data can be, other than good.

/// Why there is no model, or no controller. In words, so that no number is silently wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Finding {
    /// Too few samples.
    #[error("the data are too short: expected at least {least} samples, found {found}")]
    TooFew {
        /// What is needed.
        least: usize,
        /// What there is.
        found: usize,
    },
    /// Time does not go on from one sample to the next.
    #[error("the data are not in order: expected a time above {before} s in sample {sample}, found {found} s")]
    NotInOrder {
        /// The sample's number, from 1.
        sample: usize,
        /// The time of the sample before.
        before: f64,
        /// Its time.
        found: f64,
    },
    /// A number is infinite or none.
    #[error("sample {sample}: expected numbers, found {found}")]
    NotANumber {
        /// The sample's number, from 1.
        sample: usize,
        /// What is there.
        found: f64,
    },
    /// The samples are not evenly spaced, where they must be.
    #[error("the samples are not evenly spaced: expected {expected} s, found {found} s up to sample {sample}")]
    Uneven {
        /// The sample's number, from 1.
        sample: usize,
        /// What most of them have.
        expected: f64,
        /// What is there.
        found: f64,
    },
    /// Nothing was asked of the motor.
    #[error("the input is 0 from beginning to end: there is nothing to respond to")]
    NoInput,
    /// Nothing came of it.
    #[error("no response at all: the input goes up to {input}, and the sensor has not moved (is the encoder dead?)")]
    NoResponse {
        /// The largest input.
        input: f64,
    },
    /// The output stops at a limit.
    #[error(
        "the response saturates: {at} s after the start it rises by {slope} a second, and then no more: it stays at \
         {limit}; take a smaller input, or end before"
    )]
    Saturated {
        /// Where it stops.
        limit: f64,
        /// When.
        at: f64,
        /// How fast it rose before.
        slope: f64,
    },
    /// The motor stops although it is driven.
    #[error(
        "the motor stops dead {at:.3} s after the start, though it is driven: an end of travel, a blocked shaft, or a \
         motor whose position, not its speed, follows the drive"
    )]
    StopsDead {
        /// When.
        at: f64,
    },
    /// The data end before the response does.
    #[error("the data end too soon for this method: by then the response has not settled")]
    NotSettled,
    /// The input is no step.
    #[error("the input is no step: expected 0 and then one value to the end")]
    NoStep,
    /// Nothing between rest and the final value was caught.
    #[error("the rise cannot be seen: no sample lies on the way from rest to the final value")]
    NoRise,
    /// The encoder counts too little to see a lag.
    #[error(
        "the encoder is too coarse to see the lag: at {speed} it counts {counts} times in a time constant of {tau} s: \
         expected at least {least}"
    )]
    Coarse {
        /// The mean speed, in units of speed.
        speed: f64,
        /// Counts in a time constant.
        counts: f64,
        /// The time constant that comes out.
        tau: f64,
        /// What is needed.
        least: f64,
    },
    /// The response is over before it can be seen, or has hardly begun.
    #[error("the time constant cannot be told from these data: {tau} s ± {half} s (95 %)")]
    Vague {
        /// What comes out.
        tau: f64,
        /// How little that means: half of the interval.
        half: f64,
    },
    /// The data end too early.
    #[error("the data are too short: they end after {passed} time constants of {tau} s: expected at least {least}")]
    TooEarly {
        /// Time constants that they last.
        passed: f64,
        /// The time constant.
        tau: f64,
        /// What is needed.
        least: f64,
    },
    /// The response does not look like the model at all.
    #[error("the model explains {fit:.0} % of the response: this motor is no {expected}")]
    NotThisModel {
        /// The goodness of fit, in %.
        fit: f64,
        /// What it was taken for.
        expected: &'static str,
    },
    /// No friction can be told from the data.
    #[error("no friction can be seen: without it, the motor explains the data as well")]
    NoFriction,
    /// No dead time can be told from the data.
    #[error("no dead time distinguishable from 0: at most {most} s")]
    NoDeadTime {
        /// The end of its interval, in s.
        most: f64,
    },
    /// The input is one value throughout, and the motor was not at rest.
    #[error("a dead time cannot be seen: the input does not change")]
    NoChange,
    /// No offset can be told from the data.
    #[error("no offset can be seen while the motor is not driven")]
    NoOffset,
    /// The sensor does not say 0 while the motor stands.
    #[error("the speed is {offset} while the undriven motor stands: an offset of the sensor, fitted and taken away")]
    Offset {
        /// What the sensor says.
        offset: f64,
    },
    /// The motor answers late.
    #[error(
        "the response is about {late} s late, or goes through a second lag: a single lag is not this motor, and its \
         numbers are biased"
    )]
    Late {
        /// By how much, in s.
        late: f64,
    },
    /// The motor has friction, and the model none.
    #[error("friction shows: without it in the model, gain and time constant are biased")]
    Friction,
    /// The encoder counts against the drive.
    #[error(
        "the gain is {gain:.4}, below 0: the encoder counts backwards for a drive that is positive; swap its channels, \
         or the motor's leads, or turn one of the signs about"
    )]
    Backwards {
        /// The gain.
        gain: f64,
    },
    /// What is left has a pattern.
    #[error(
        "what the model leaves unexplained is no noise, but has a pattern ({left} of speed, root mean square): this \
         motor is no single lag (does it oscillate, or run into a limit, or has it something loose?)"
    )]
    Pattern {
        /// How much of it there is, in units of speed.
        left: f64,
    },
    /// A regression gives a pole that no lag has.
    #[error("the regression gives a pole of {pole:.4}: no lag has that")]
    NoLag {
        /// The pole.
        pole: f64,
    },
    /// A step response does not overshoot as one of the second order does.
    #[error("the response does not overshoot: the paper's formulas (Eq. 8 to 10) need one that does")]
    NoOvershoot,
    /// An iteration does not come to an end.
    #[error("the fit does not converge")]
    NoConvergence,
    /// The loop is unstable.
    #[error("the loop is unstable: largest pole {pole:.4}")]
    Unstable {
        /// The largest modulus of a pole.
        pole: f64,
    },
    /// No controller of this kind does what is asked.
    #[error("no {law} has a phase margin of {margin}° at any crossover down to {crossover} rad/s: ask for less")]
    NoController {
        /// The law.
        law: &'static str,
        /// What was asked, in degrees.
        margin: f64,
        /// The lowest crossover that was tried, in rad/s.
        crossover: f64,
    },
}
