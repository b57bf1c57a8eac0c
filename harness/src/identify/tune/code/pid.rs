//! The PID of a feed axis (Eq. 14), with its feed-forward and its rules against friction.

use torno_machines::motor::{FeedLaw, FeedSample, KEPT};

use super::{Coefficient, ROOM, ROUNDED, Written, test, whole};

/// An error up to this, in counts, must have room: the set point waits before.
const ERROR: f64 = 1_000.0;
/// Bits behind the point, at most.
const MOST: u32 = 18;

/// What the law is in fixed point.
struct Fixed {
    bits: u32,
    error_max: i64,
    stuck_max: i64,
    /// K1, K2, K2 while standing, K3/T, speed, acceleration and break-away.
    coefficients: [Coefficient; 7],
}

impl Fixed {
    fn of(law: &FeedLaw) -> Self {
        let t = law.sample_s;
        let slope = law.k3 / t;
        // Half of the room is for the error and its slope, the rest for the integral and the set point.
        let per_count = law.k1 + 2.0 * slope;
        let need = (2.0 * per_count * ERROR).max(4.0 * law.full as f64);
        let bits = super::fraction(need, MOST);
        let one = libm::ldexp(1.0, bits as i32);
        let error_max = (0.5 * ROOM / (per_count.max(1e-9) * one)).min(32_767.0) as i64;
        let breakaway = law.breakaway * t * t;
        let stuck_max = (0.25 * ROOM / (breakaway.max(1e-9) * one)).min(30_000.0) as i64;
        let of = |name, about, value| Coefficient { name, about, value, fraction: bits };
        let coefficients = [
            of("K1", "LSB per count", law.k1),
            of("K2", "K2 T, LSB per count", law.k2 * t),
            of("K2_STANDING", "K2 T while set point and axis stand, LSB per count", law.k2_standing * t),
            of("K3", "K3 / T, LSB per count", slope),
            of("PER_SPEED", "LSB per count a sample of the set point", law.per_speed),
            of("PER_ACCEL", "LSB per count a sample^2 of the set point", law.per_acceleration),
            of("BREAKAWAY", "LSB per sample^2", breakaway),
        ];
        Self { bits, error_max, stuck_max, coefficients }
    }

    /// How far the drive can be off before it is rounded, in these samples: the integral sums its roundings up.
    fn bound(&self, law: &FeedLaw, samples: &[FeedSample]) -> f64 {
        let [k1, k2, standing, k3, speed, acceleration, breakaway] =
            self.coefficients.each_ref().map(|coefficient| coefficient.error().abs());
        let rounding = libm::ldexp(1.0, -(self.bits as i32));
        let (mut integral, mut previous, mut stuck, mut most) = (0.0, 0, 0, 0.0_f64);
        for sample in samples {
            stuck = if sample.moved || sample.error.abs() <= law.dead_band { 0 } else { stuck + 1 };
            if sample.error.abs() <= law.zone {
                integral += k2.max(standing) * sample.error.abs() as f64;
            }
            integral += breakaway * f64::from((stuck - 1).max(0));
            integral += if sample.moved { rounding } else { 0.0 };
            let direct = k1 * sample.error.abs() as f64
                + k3 * (sample.error - previous).abs() as f64
                + speed * sample.speed.abs() as f64
                + acceleration * sample.acceleration.abs() as f64;
            previous = sample.error;
            most = most.max(integral + direct);
        }
        most
    }
}

/// The law in C.
pub(super) fn written(law: &FeedLaw, samples: &[FeedSample], head: &str) -> Written {
    let fixed = Fixed::of(law);
    let bound_lsb = fixed.bound(law, samples);
    let coefficients: String = fixed.coefficients.iter().map(Coefficient::line).collect();
    let taken = i64::from(libm::round(1.0 / KEPT) as i32);
    let defines = [
        coefficients,
        whole("FRACTION", i64::from(fixed.bits), "bits behind the point"),
        whole("KEPT_OF", taken, "an axis that moves keeps one part of so many of what it gained while stuck"),
        whole("DEAD_BAND", law.dead_band, "counts"),
        whole("ZONE", law.zone.min(32_767), "counts: a larger error is not integrated"),
        whole("STANDS", law.stands_samples, "samples without a count"),
        whole("ERROR_MAX", fixed.error_max, "counts: a larger error is limited to it"),
        whole("STUCK_MAX", fixed.stuck_max, "samples"),
        whole("FULL", law.full, "LSB"),
    ]
    .concat();
    let row = |sample: &FeedSample| {
        let FeedSample { error, speed, acceleration, finished, moved, drive } = *sample;
        vec![error, speed, acceleration, i64::from(finished), i64::from(moved), drive]
    };
    let vectors = test(&["error", "speed", "acceleration", "finished", "moved"], samples.iter().map(row));
    let source = format!(
        "\
/* PID on position (Eq. 14), with feed-forward and the rules against friction. By torno tune --code c.
 * {head}
 *
 *   I(k) = I(k-1) + K2 T e(k),  u(k) = K1 e(k) + I(k) + (K3/T) (e(k) - e(k-1)) + feed-forward,  -FULL <= u <= FULL
 *
 * I holds while u is limited in its sense, outside the zone, and within the dead band once the axis stands. While the
 * axis is stuck it grows faster and faster; when the axis moves, most of that is taken back.
 * Sums and products have 32 bits, which suits a PIC of 8 bits and a dsPIC.
 *
 * Rounding: in the test vectors below, u is off by less than {bound_lsb:.3} LSB before it is rounded, as long as it
 * meets its limit in the same samples. So the drive differs from the board's (double precision) by 1 LSB at most, and
 * only where u is that near to a half.
 * Test: cc -DTORNO_TEST FILE -o test && ./test */

#include <stdint.h>

{defines}
static int32_t integral, gained, previous;
static int16_t still, stuck;

{ROUNDED}
void torno_reset(void)
{{
    integral = gained = previous = 0;
    still = stuck = 0;
}}

/* One sample: the set point less the count, the set point's speed and acceleration in counts a sample and a sample^2,
 * whether it stands at its target, and whether the axis has counted since the sample before. Gives the drive. */
int16_t torno_step(int16_t set_point_less_count, int16_t speed, int16_t acceleration, int16_t finished, int16_t moved)
{{
    int32_t error = limited(set_point_less_count, -ERROR_MAX, ERROR_MAX);
    int32_t size = error < 0 ? -error : error;
    int32_t growth, wanted, drive;

    still = moved ? 0 : still < 30000 ? still + 1 : still;
    stuck = moved || size <= DEAD_BAND ? 0 : stuck < STUCK_MAX ? stuck + 1 : stuck;
    if (moved) {{
        integral -= gained - gained / KEPT_OF;
        gained = 0;
    }}
    growth = 0;
    if (size <= ZONE && !(finished && still >= STANDS && size <= DEAD_BAND))
        growth = (finished && still > 0 ? K2_STANDING : K2) * error;
    if (stuck > 1)
        growth += error < 0 ? -(BREAKAWAY * (stuck - 1)) : BREAKAWAY * (stuck - 1);

    wanted = K1 * error + integral + growth + K3 * (error - previous) + PER_SPEED * speed + PER_ACCEL * acceleration;
    drive = limited(wanted, -(FULL << FRACTION), FULL << FRACTION);
    if (wanted == drive || (wanted > drive ? error <= 0 : error >= 0)) {{
        integral += growth;
        if (stuck > 0 && BREAKAWAY > 0)
            gained += growth;
    }}
    previous = error;
    return (int16_t)rounded(drive, FRACTION);
}}

{vectors}"
    );
    Written { bound_lsb, source }
}
