//! Files whose truth is known, and what is made of them.

use super::*;

mod kinds;

/// Nothing is known of the encoder.
const ANY: Encoder = Encoder { counts_per_rev: None, bits: None };

fn complaint(text: &str) -> String {
    parse("my.csv", text, &ANY).unwrap_err().to_string()
}

#[test]
fn complaints_say_where_and_what_was_expected() {
    for (text, expected) in [
        ("", "my.csv:1:1: expected a line with the columns' names"),
        ("time_s,input\n", "my.csv:1:1: expected a column counts, position or speed, found 'time_s,input'"),
        ("time_s,inptu,counts\n", "my.csv:1:8: unknown column 'inptu': did you mean 'input'?"),
        ("time_h,input,counts\n", "my.csv:1:1: unknown unit of time 'h': expected s, ms, us, ns or min"),
        ("time_s,input,counts\n0,0,0\n0.03,\"2,1\n", "my.csv:3:6: expected a quote at the end of \"2,1"),
        ("time_s,counts,input,speed\n", "my.csv:1:21: expected one column with the output"),
        ("# log\ntime_s,input,counts\n0,0,0\n0.03,20,1.x\n", "my.csv:4:9: expected a number, found '1.x'"),
        ("time_s,input,counts\n0,0,0\n0.03,,1\n", "my.csv:3:6: expected a number, found ''"),
        ("time_s,input,counts\n0,0,nan\n", "my.csv:2:5: expected a number, found 'nan'"),
        ("time_s,input,counts\n0,0,0\n0.03,20\n", "my.csv:3:1: expected 3 values, found 2"),
        ("time_s,input,counts\n0,0,0\n0.03,20,1,7\n", "my.csv:3:11: expected 3 values, found 4"),
        ("time_s,input,counts\n0,0,0\n0.03,2,1\n0.03,2,1\n", "my.csv:4:1: expected a time above 0.03 s, found 0.03 s"),
        (
            "time_s,input,counts\n0,0,0\n0.03,2,1\n",
            "my.csv: the data are too short: expected at least 20 samples, found 1",
        ),
    ] {
        let found = complaint(text);
        assert!(found.starts_with(expected), "{found}\nexpected {expected}");
    }
}

#[test]
fn what_spreadsheets_write_is_read() {
    let row = |n: u32| format!("{:.2},5,{:.3}\n", 0.02 * f64::from(n), 100.0 * -libm::expm1(-0.04 * f64::from(n)));
    let rows: String = (0..150).map(row).collect();
    let expected = parse("my.csv", &format!("time_s,input_v,speed\n{rows}"), &ANY).unwrap();
    let quoted = format!("\"time_s\",\"input_v\",\"speed\"\n{rows}");
    let semicolons = format!("time_s;input_v;speed\n{}", rows.replace(',', ";").replace('.', ","));
    let tabs = format!("time_s\tinput_v\tspeed\n{}", rows.replace(',', "\t"));
    for text in [quoted, semicolons, tabs] {
        assert_eq!(parse("my.csv", &text, &ANY).unwrap(), expected, "{}", &text[..40]);
    }
    // The motor was at rest, although the first sample is 4 % of the last and the second 8 %.
    assert!(expected.data.starts_at_rest());
}

#[test]
fn rows_that_are_missing_are_told_by_their_place() {
    let row = |n: u32| format!("{:.2},5,{}\n", 0.02 * f64::from(n), n * n / 40);
    let rows: String = (0..200).filter(|n| *n < 100 || n % 3 == 0).map(row).collect();
    let measured = parse("my.csv", &format!("time_s,input,position\n{rows}"), &ANY).unwrap();
    assert!((measured.data.period() - 0.02).abs() < 1e-9);
    let finding = measured.data.even_period().unwrap_err().to_string();
    assert_eq!(finding, "the samples are not evenly spaced: expected 0.02 s, found 0.06 s up to sample 100");
}

#[test]
fn counts_position_and_speed_are_the_same_motor() {
    let lag = |t: f64| 100.0 * (t - 0.5 * -libm::expm1(-t / 0.5));
    let mut texts =
        ["time_s,input_v,counts\n", "input_v,time_s,position\n", "time_s,input_v,speed_rpm\n"].map(str::to_owned);
    for n in 0..200 {
        let (t, before) = (0.05 * f64::from(n), 0.05 * f64::from(n - 1).max(0.0));
        texts[0] += &format!("{t},10,{}\n", lag(t) - lag(before));
        texts[1] += &format!("10, {t}, {}\r\n", lag(t));
        texts[2] += &format!("{t},10,{}\n", 100.0 * -libm::expm1(-t / 0.5));
    }
    let units = ["counts/s", "counts/s", "rpm"];
    for (text, unit) in texts.iter().zip(units) {
        let measured = parse("my.csv", text, &ANY).unwrap();
        assert_eq!((measured.units.input.as_str(), measured.units.speed.as_str()), ("V", unit));
        let fitted = torno_identify::nls::first_order(&measured.data).unwrap();
        assert!((fitted.gain.value - 10.0).abs() < 1e-6 && (fitted.tau.value - 0.5).abs() < 1e-6, "{fitted:?}");
    }
}
