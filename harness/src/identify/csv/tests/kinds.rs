//! Kinds of files that spreadsheets, loggers and encoders make, with motors that are known: three files of each kind.

use core::fmt::Write as _;

use super::{ANY, Encoder, parse};
use crate::identify::bench::Recording;
use crate::identify::{Identification, Method};

/// A motor: its gain in rad/s per V, and its time constant in s.
type Motor = (f64, f64);

const MOTORS: [Motor; 3] = [(12.0, 0.4), (7.0, 0.9), (30.0, 0.15)];
const PERIOD: f64 = 0.02;

/// A row: time, input, angle in rad and speed in rad/s.
type Row = [f64; 4];

/// What the motor does, by the solution of its equation; `at` are the times of the rows.
fn run((gain, tau): Motor, at: &[f64], input: impl Fn(usize) -> f64) -> Vec<Row> {
    let (mut angle, mut speed) = (0.0, 0.0);
    let mut rows = vec![[at[0], input(0), 0.0, 0.0]];
    for n in 1..at.len() {
        let (end, length) = (gain * input(n - 1), at[n] - at[n - 1]);
        let rest = (speed - end) * libm::exp(-length / tau);
        angle += end * length + tau * (speed - end - rest);
        speed = end + rest;
        rows.push([at[n], input(n), angle, speed]);
    }
    rows
}

fn even(rows: u32) -> Vec<f64> {
    (0..rows).map(|n| PERIOD * f64::from(n)).collect()
}

/// 5 V from the first row on.
fn step(motor: Motor) -> Vec<Row> {
    run(motor, &even(400), |_| 5.0)
}

/// Between `low` and 6 V, changing about every 0.4 s.
fn sequence(motor: Motor, low: f64, at: &[f64]) -> Vec<Row> {
    let mut random = Random(11);
    let bits: Vec<bool> = (0..at.len()).map(|_| random.uniform() < 0.5).collect();
    run(motor, at, |n| if bits[n / 20] { 6.0 } else { low })
}

/// xorshift64*, so that files are always the same.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A text of a head and a line for each row.
fn text(head: &str, rows: &[Row], line: impl Fn(&Row) -> String) -> String {
    rows.iter().fold(format!("{head}\n"), |mut text, row| {
        let _ = writeln!(text, "{}", line(row));
        text
    })
}

fn encoder(counts_per_rev: f64) -> Encoder {
    Encoder { counts_per_rev: Some(counts_per_rev), bits: None }
}

fn unwrapped(bits: u32) -> Encoder {
    Encoder { counts_per_rev: Some(200.0), bits: Some(bits) }
}

fn identify(text: &str, encoder: &Encoder) -> Identification {
    let measured = parse("my.csv", text, encoder).unwrap_or_else(|error| panic!("{error}"));
    let recording = Recording { data: measured.data, closed: None, what: "data".to_owned() };
    let found = Identification::of("my.csv".to_owned(), measured.units, measured.axis, vec![Ok(recording)], None);
    let mut found = found.unwrap_or_else(|error| panic!("{error}"));
    found.notes = measured.notes;
    found
}

/// The result is this motor's, with gain times `unit`, within so many %, and nothing speaks against it.
fn is_clear(found: &Identification, (gain, tau): Motor, unit: f64, percent: f64) {
    is_near(found, (gain, tau), unit, percent);
    assert!(found.result.warnings.is_empty(), "{found}");
    let [low, high] = found.result.tau_s_interval.unwrap();
    let slack = 1e-3 * tau;
    assert!(low - slack <= tau && tau <= high + slack, "{found}");
}

fn is_near(found: &Identification, (gain, tau): Motor, unit: f64, percent: f64) {
    for (value, truth) in [(found.result.gain, gain * unit), (found.result.tau_s, tau)] {
        assert!((value / truth - 1.0).abs() < percent / 100.0, "{value}, expected {truth}\n{found}");
    }
}

fn refused(text: &str, encoder: &Encoder, expected: &str) {
    let found = parse("my.csv", text, encoder).unwrap_err().to_string();
    assert!(found.contains(expected), "{found}\nlacks {expected}");
}

fn comma(number: f64, digits: usize) -> String {
    format!("{number:.digits$}").replace('.', ",")
}

/// With `mark` between thousands, and the other one for decimals.
fn parted(number: f64, digits: usize, mark: char) -> String {
    let decimal = if mark == '.' { ',' } else { '.' };
    let plain = format!("{:.digits$}", number.abs());
    let (whole, rest) = plain.split_once('.').unwrap_or((&plain, ""));
    let mut parted = String::new();
    for (place, digit) in whole.chars().enumerate() {
        if place > 0 && (whole.len() - place).is_multiple_of(3) {
            parted.push(mark);
        }
        parted.push(digit);
    }
    let sign = if number < 0.0 { "-" } else { "" };
    if rest.is_empty() { format!("{sign}{parted}") } else { format!("{sign}{parted}{decimal}{rest}") }
}

#[test]
fn fields_in_quotes_may_hold_what_separates_them() {
    for motor in MOTORS {
        let rows = step(motor);
        let quoted = |[t, u, _, v]: &Row| format!("\"{}\",\"{}\",\"{}\"", comma(*t, 2), comma(*u, 1), comma(*v, 4));
        let named = |[t, u, _, v]: &Row| format!("{t:.2};{u};\"{v:.4}\"");
        for text in [
            text("\"time_s\",\"input_v\",\"speed\"", &rows, quoted),
            text("\"Time, s\";\"Input; V\";\"Speed (rad/s; shaft)\"", &rows, named),
            text("\"time_s\",\"input, V\",\"speed, rad/s\"", &rows, |[t, u, _, v]| format!("{t:.2},\"{u}\",{v:.4}")),
        ] {
            let found = identify(&text, &ANY);
            is_clear(&found, motor, 1.0, 0.05);
            assert_eq!(found.units.input, "V");
        }
    }
}

#[test]
fn a_decimal_comma_beside_a_thousands_point_is_read_right_or_refused() {
    for motor in MOTORS {
        let rows = step(motor);
        // Thousandths of rad/s.
        for (head, mark, separator) in
            [("time_s;input_v;speed_mrad", '.', ";"), ("time_s\tinput_v\tspeed_mrad", ',', "\t")]
        {
            let line = |[t, u, _, v]: &Row| {
                [parted(*t, 2, mark), parted(*u, 1, mark), parted(1e3 * v, 2, mark)].join(separator)
            };
            is_clear(&identify(&text(head, &rows, line), &ANY), motor, 1e3, 0.05);
        }
        // A point that parts thousands, or a decimal one: the time alone does not tell.
        let line = |[t, u, _, v]: &Row| format!("{};{u};{}", comma(*t, 2), parted((1e3 * v).round(), 0, '.'));
        refused(&text("time_s;input_v;speed", &rows, line), &ANY, "expected numbers without marks between thousands");
    }
    let two = "time_s;input;speed\n0;5;1,5\n0.02;5;2.5\n";
    refused(two, &ANY, "my.csv:3:8: '2.5' has the decimal mark '.', '1,5' before has ','");
}

#[test]
fn lines_of_sep_and_carriage_returns_alone_are_read() {
    for motor in MOTORS {
        let rows = step(motor);
        let semicolons = text("sep=;\ntime_s;input_v;speed", &rows, |[t, u, _, v]| format!("{t:.2};{u};{v:.4}"));
        let commas = text("time_s,input_v,speed", &rows, |[t, u, _, v]| format!("{t:.2},{u},{v:.4}"));
        let bars =
            text("\"sep=|\"\ntime_s|input_v|speed", &rows, |[t, u, _, v]| format!("{t:.2}|{u}|{}", comma(*v, 4)));
        for text in [semicolons.replace('\n', "\r\n"), commas.replace('\n', "\r"), bars.replace('\n', "\r")] {
            is_clear(&identify(&text, &ANY), motor, 1.0, 0.05);
        }
    }
    refused("time_s,input,speed\r0,5,1\r0.02,5,x\r", &ANY, "my.csv:3:8: expected a number, found 'x'");
}

#[test]
fn a_position_has_the_unit_that_it_names() {
    for motor in MOTORS {
        let rows = sequence(motor, -6.0, &even(800));
        for (head, unit, speed) in [
            ("time_s,input_v,position_rad", 1.0, "rad/s"),
            ("time_s,input_v,position_deg", 360.0 / core::f64::consts::TAU, "deg/s"),
            // A screw of 5 mm.
            ("time_s,input_v,Position [mm]", 5.0 / core::f64::consts::TAU, "mm/s"),
        ] {
            let found = identify(&text(head, &rows, |[t, u, x, _]| format!("{t:.2},{u},{:.6}", x * unit)), &ANY);
            is_clear(&found, motor, unit, 0.05);
            assert_eq!((found.units.speed.as_str(), found.axis), (speed, true));
        }
        // It is whole counts even so.
        let slot = core::f64::consts::TAU / 200.0;
        let line = |[t, u, x, _]: &Row| format!("{t:.2},{u},{:.5}", (x / slot).floor() * slot);
        let measured = parse("my.csv", &text("time_s,input_v,position_rad", &rows, line), &ANY).unwrap();
        assert!((measured.data.quantum() * PERIOD / slot - 1.0).abs() < 1e-3, "{}", measured.data.quantum());
    }
}

#[test]
fn time_has_the_unit_that_it_names() {
    for motor in MOTORS {
        let rows = step(motor);
        for (head, second, notes) in
            [("time_ms", 1e3, 0), ("Time [us]", 1e6, 0), ("t", 1.0, 1), ("t_min", 1.0 / 60.0, 0)]
        {
            let head = format!("{head},input_v,speed");
            let found = identify(&text(&head, &rows, |[t, u, _, v]| format!("{},{u},{v:.4}", t * second)), &ANY);
            is_clear(&found, motor, 1.0, 0.05);
            // What is taken for granted is said.
            assert_eq!(found.notes.len(), notes, "{found}");
        }
    }
}

#[test]
fn an_option_without_effect_is_refused() {
    let rows = step(MOTORS[0]);
    let counts = encoder(200.0);
    let bits = Encoder { counts_per_rev: None, bits: Some(8) };
    for (head, encoder, expected) in [
        ("time_s,input_v,speed", counts, "my.csv:1:16: --counts-per-rev has no effect on 'speed'"),
        ("time_s,input_v,position_rad", counts, "my.csv:1:16: --counts-per-rev has no effect on 'position_rad'"),
        ("time_s,speed,input_v", bits, "my.csv:1:8: --unwrap has no effect on 'speed'"),
    ] {
        refused(&text(head, &rows, |[t, u, _, v]| format!("{t},{u},{v}")), &encoder, expected);
    }
    let line = |[t, u, x, _]: &Row| format!("{t},{u},{}", (30.0 * x).floor());
    refused(&text("time_s,input_v,position", &rows, line), &bits, "expected what a counter of 8 bits can hold");
}

#[test]
fn time_stamps_may_jitter() {
    for (motor, jitter, per_rev) in [(MOTORS[0], 0.5e-3, 200.0), (MOTORS[1], 2e-3, 4_000.0), (MOTORS[2], 1e-3, 50.0)] {
        let rows = sequence(motor, 2.0, &even(1_000));
        let slot = core::f64::consts::TAU / per_rev;
        let mut random = Random(7);
        let stamped: Vec<Row> = rows.iter().map(|[t, u, x, v]| [t + jitter * random.normal(), *u, *x, *v]).collect();
        let text =
            text("time_s,input_v,position", &stamped, |[t, u, x, _]| format!("{t:.6},{u},{}", (x / slot).floor()));
        is_clear(&identify(&text, &encoder(per_rev)), motor, 1.0, 1.0);
    }
}

#[test]
fn a_code_wheel_may_be_off_its_centre() {
    for (motor, off, per_rev) in [(MOTORS[0], 2.0, 200.0), (MOTORS[1], 5.0, 500.0), (MOTORS[2], 1.0, 60.0)] {
        let rows = sequence(motor, 2.0, &even(1_000));
        let counted = |x: f64| (x * per_rev / core::f64::consts::TAU + off * libm::sin(x + 1.0)).floor();
        let text = text("time_s,input_v,position", &rows, |[t, u, x, _]| format!("{t:.2},{u},{}", counted(*x)));
        let found = identify(&text, &encoder(per_rev));
        is_clear(&found, motor, 1.0, 0.2);
        let [note] = &found.notes[..] else { panic!("{found}") };
        let told: f64 = note.split_whitespace().find_map(|word| word.parse().ok()).unwrap();
        assert!((told / off - 1.0).abs() < 0.15, "{note}");
    }
}

#[test]
fn a_counter_that_wraps_is_named_and_unwrapped() {
    let slot = core::f64::consts::TAU / 200.0;
    let count = |x: f64| (x / slot).floor();
    for motor in MOTORS {
        let rows = sequence(motor, -6.0, &even(800));
        let plain = text("time_s,input_v,position", &rows, |[t, u, x, _]| format!("{t:.2},{u},{}", count(*x)));
        let plain = identify(&plain, &encoder(200.0));
        is_clear(&plain, motor, 1.0, 0.2);
        let wrapped = |bits: u32, from: f64| {
            let range = f64::from(1u32 << bits);
            text("time_s,input_v,position", &rows, |[t, u, x, _]| {
                format!("{t:.2},{u},{}", (count(*x) + from).rem_euclid(range))
            })
        };
        let mut before = 0.0;
        let counts: Vec<Row> = rows
            .iter()
            .map(|[t, u, x, v]| {
                let moved = count(*x) - core::mem::replace(&mut before, count(*x));
                [*t, *u, moved.rem_euclid(256.0), *v]
            })
            .collect();
        let counts = text("time_s,input_v,counts", &counts, |[t, u, counted, _]| format!("{t:.2},{u},{counted}"));
        for (text, bits) in [(wrapped(8, 0.0), 8), (wrapped(16, 65_500.0), 16), (counts, 8)] {
            refused(&text, &encoder(200.0), &format!("a counter of {bits} bits that wraps: give --unwrap {bits}"));
            let found = identify(&text, &unwrapped(bits));
            assert_eq!((found.result.gain, found.result.tau_s), (plain.result.gain, plain.result.tau_s));
        }
    }
    let fast = "time_s,input,position\n0,5,0\n0.02,5,20\n0.04,5,145\n";
    refused(
        fast,
        &Encoder { counts_per_rev: None, bits: Some(8) },
        "my.csv:4:8: moves by 125 of 256 from the row before",
    );
}

#[test]
fn rows_that_were_misread_are_named() {
    let slot = core::f64::consts::TAU / 200.0;
    for motor in MOTORS {
        let rows = sequence(motor, 2.0, &even(400));
        let with = |head: &str, wrong: fn(f64) -> f64, from: usize, to: usize| {
            let output = |n: usize, row: &Row| {
                let value = if head.ends_with("speed") { row[3] } else { (row[2] / slot).floor() };
                if (from..to).contains(&n) { wrong(value) } else { value }
            };
            let lines =
                rows.iter().enumerate().map(|(n, row)| format!("{:.2},{},{}\n", row[0], row[1], output(n, row)));
            format!("{head}\n{}", lines.collect::<String>())
        };
        let (position, speed) = ("time_s,input_v,position", "time_s,input_v,speed");
        let alone = "and back, between";
        for (text, line, expected) in [
            (with(position, |x| x + 4_096.0, 215, 216), 217, alone),
            (with(position, |_| 0.0, 215, 216), 217, alone),
            (with(speed, |_| 0.0, 215, 216), 217, alone),
            // Reset in the middle.
            (with(position, |x| x - 1_000.0, 215, 400), 217, "was the counter reset?"),
        ] {
            let found = parse("my.csv", &text, &ANY).unwrap_err().to_string();
            assert!(found.starts_with(&format!("my.csv:{line}:")) && found.contains(expected), "{found}");
        }
        // Without that row, it is the motor.
        let zero = with(position, |_| 0.0, 215, 216);
        let kept: Vec<&str> = zero.lines().enumerate().filter(|(n, _)| *n != 216).map(|(_, line)| line).collect();
        is_clear(&identify(&kept.join("\n"), &encoder(200.0)), motor, 1.0, 0.5);
    }
}

#[test]
fn a_sensor_that_is_off_is_not_taken_for_gain() {
    for (motor, off) in [(MOTORS[0], 3.0), (MOTORS[1], -0.8), (MOTORS[2], 12.0)] {
        let mut random = Random(5);
        let rows = run(motor, &even(500), |n| if n < 25 { 0.0 } else { 5.0 });
        let noisy: Vec<Row> = rows.iter().map(|[t, u, x, v]| [*t, *u, *x, v + off + 0.05 * random.normal()]).collect();
        let found = identify(&text("time_s,input_v,speed", &noisy, |[t, u, _, v]| format!("{t:.2},{u},{v:.4}")), &ANY);
        is_near(&found, motor, 1.0, 0.5);
        assert_eq!(found.result.method, Method::NlsOffset);
        assert!(found.result.warnings[0].contains("while the undriven motor stands"), "{found}");
        assert!(!found.to_string().contains('*'), "{found}");
        // A motor that turns at first has no offset for that.
        let coasting = run(motor, &even(500), |n| {
            if n < 60 {
                5.0
            } else if n < 75 {
                0.0
            } else {
                6.0
            }
        });
        let found =
            identify(&text("time_s,input_v,speed", &coasting[60..], |[t, u, _, v]| format!("{t:.2},{u},{v:.6}")), &ANY);
        is_clear(&found, motor, 1.0, 0.1);
    }
}
