//! The compensator of a main motor (Eq. 7, incremental).

use torno_machines::motor::{SpeedLaw, SpeedSample};

use super::{Coefficient, ROUNDED, Written, fraction, test, whole};

/// β has so many bits behind the point.
const BETA: u32 = 15;
/// The error is in the set point's unit with so many bits behind the point, at most.
const MOST_OF_ERROR: u32 = 6;
/// A larger error is limited to it, in units of the set point: twice what any set point is.
const ERROR_MAX: f64 = 400.0;

/// What the law is in fixed point.
struct Fixed {
    of_error: u32,
    per_count: Coefficient,
    change: Coefficient,
    stays: Coefficient,
    beta: Coefficient,
}

impl Fixed {
    fn of(law: &SpeedLaw) -> Self {
        let per_count = law.rpm_per_count / law.rpm_per_unit;
        let is_whole = |bits: &u32| {
            let scaled = libm::ldexp(per_count, *bits as i32);
            (scaled - libm::round(scaled)).abs() < 1e-9
        };
        let of_error = (0..MOST_OF_ERROR).find(is_whole).unwrap_or(MOST_OF_ERROR);
        let b0 = law.k * law.rpm_per_unit;
        let b1 = b0 * (1.0 - law.alpha);
        let scale = libm::ldexp(1.0, -(of_error as i32));
        // c is a geometric sum of what the largest jump of the error gives.
        let largest = b0 * 2.0 * ERROR_MAX / (1.0 - law.beta.abs()) + law.full as f64;
        let bits = fraction(largest, 16);
        let fine = fraction(b1 * ERROR_MAX, bits + 10);
        Self {
            of_error,
            per_count: Coefficient {
                name: "PER_COUNT",
                about: "units of the error per count",
                value: per_count,
                fraction: of_error,
            },
            change: Coefficient {
                name: "B0",
                about: "K, LSB per unit of the error",
                value: b0 * scale,
                fraction: bits,
            },
            stays: Coefficient {
                name: "B1",
                about: "K (1 - alpha), LSB per unit of the error",
                value: b1 * scale,
                fraction: fine.max(bits),
            },
            beta: Coefficient { name: "BETA", about: "-beta", value: -law.beta, fraction: BETA },
        }
    }

    /// How far the drive can be off before it is rounded, in these samples: what each rounding adds is carried on by β,
    /// and the drive sums it. A limit only takes away.
    fn bound(&self, samples: &[SpeedSample]) -> f64 {
        let (mut previous, mut output, mut off, mut sum, mut most) = (None::<f64>, 0.0, 0.0, 0.0, 0.0_f64);
        let scale = libm::ldexp(1.0, self.of_error as i32);
        let rounding = libm::ldexp(1.0, -(self.change.fraction as i32));
        for sample in samples {
            if sample.set_point == 0 {
                (previous, output, off, sum) = (None, 0.0, 0.0, 0.0);
                continue;
            }
            let error = scale * (sample.set_point as f64 - self.per_count.value * sample.counts as f64);
            let before = previous.unwrap_or(error);
            // A count that is rounded moves the error, and with it what follows.
            let of_count = scale * self.per_count.error().abs() * sample.counts as f64;
            let (changed, stays) = (error - before, before);
            let mut added = self.change.error().abs() * changed.abs() + self.stays.error().abs() * stays.abs();
            added += self.beta.error().abs() * f64::abs(output) + rounding;
            added += of_count * (2.0 * self.change.value + self.stays.value);
            off = self.beta.value.abs() * off + added;
            output = self.beta.value * output + self.change.value * changed + self.stays.value * stays;
            sum += off;
            most = most.max(sum);
            previous = Some(error);
        }
        most
    }
}

/// The law in C.
pub(super) fn written(law: &SpeedLaw, samples: &[SpeedSample], head: &str) -> Written {
    let fixed = Fixed::of(law);
    let bound_lsb = fixed.bound(samples);
    let (bits, down) = (fixed.change.fraction, fixed.stays.fraction - fixed.change.fraction);
    let unit = law.rpm_per_unit;
    let defines = [
        fixed.per_count.line(),
        fixed.change.line(),
        fixed.stays.line(),
        fixed.beta.line(),
        whole("FRACTION", i64::from(bits), "bits behind the point of B0, c and u"),
        whole("FINER", i64::from(down), "and so many more of B1"),
        whole("ERROR_BITS", i64::from(fixed.of_error), "bits behind the point of the error"),
        whole("ERROR_MAX", (ERROR_MAX as i64) << fixed.of_error, "a larger error is limited to it"),
        whole("FULL", law.full, "LSB"),
    ]
    .concat();
    let vectors = test(
        &["set point", "counts"],
        samples.iter().map(|sample| vec![sample.set_point, sample.counts, sample.drive]),
    );
    let source = format!(
        "\
/* Lead compensator, incremental (Eq. 7). By torno tune --code c.
 * {head}
 *
 *   c(k) = -beta c(k-1) + K (e(k) - alpha e(k-1)),  u(k) = u(k-1) + c(k),  0 <= u <= FULL
 *
 * K (e(k) - alpha e(k-1)) is B0 (e(k) - e(k-1)) + B1 e(k-1): what is small has a coefficient of its own.
 * The error is in units of {unit} rpm. Sums and products have 32 bits, which suits a PIC of 8 bits and a dsPIC.
 *
 * Rounding: in the test vectors below, u is off by less than {bound_lsb:.2} LSB before it is rounded. So the drive
 * differs from the board's (double precision) by 1 LSB at most, and only where u is that near to a half.
 * Test: cc -DTORNO_TEST FILE -o test && ./test */

#include <stdint.h>

{defines}
static int32_t c, u, previous;
static uint8_t running;

{ROUNDED}
/* a BETA / 2^{BETA}, in halves, so that no product needs more than 32 bits */
static int32_t times_beta(int32_t a)
{{
    uint32_t beta = BETA < 0 ? -(BETA) : BETA, size = a < 0 ? -a : a;
    int32_t product = (int32_t)((size >> {BETA}) * beta + (((size & 0x7fffUL) * beta + 0x4000UL) >> {BETA}));

    return (a < 0) != (BETA < 0) ? -product : product;
}}

void torno_reset(void)
{{
    c = u = previous = 0;
    running = 0;
}}

/* One window: the set point in units of {unit} rpm and the counts of the window; gives the width of the pulse. */
int16_t torno_step(int16_t set_point, int16_t counts)
{{
    int32_t error;

    if (set_point == 0) {{
        torno_reset();
        return 0;
    }}
    error = limited(((int32_t)set_point << ERROR_BITS) - PER_COUNT * counts, -ERROR_MAX, ERROR_MAX);
    if (!running)
        previous = error;
    running = 1;
    c = times_beta(c) + B0 * (error - previous) + rounded(B1 * previous, FINER);
    u = limited(u + c, 0, FULL << FRACTION);
    previous = error;
    return (int16_t)rounded(u, FRACTION);
}}

{vectors}"
    );
    Written { bound_lsb, source }
}
