//! The servo stand's board: its answers byte by byte, its loop tick by tick, and where it gives up.

#![allow(clippy::unwrap_used, reason = "part of tests")]

mod common;

use common::{Bench, s};
use torno_protocol::board::{Board, Capability, MotorStimulus, Output, Role, Stimulus};
use torno_protocol::clock::Clock;
use torno_protocol::servo::{Command, GAP};
use torno_protocol::time::{Instant, Span};
use torno_protocol::uart::Character;
use torno_slaves::{KvOn, Servo, ServoSettings};

/// 500 rpm at 250 pulses a revolution, in counts a tick of 5 ms.
const FULL: f64 = 500.0 * 250.0 / 60.0 * 0.005;
/// 425 mm at 125 counts a mm.
const TRAVEL: i64 = 53_125;

fn servo(change: impl Fn(&mut ServoSettings)) -> Bench<Servo> {
    let mut settings = ServoSettings::default();
    change(&mut settings);
    settings.check().unwrap();
    Bench::as_switched_on(Servo::new(&settings, Clock::TRUE))
}

/// A command, and the silence that completes it.
fn say(bench: &mut Bench<Servo>, command: Command) {
    bench.send(&command.emit());
    bench.run_ms(4);
}

/// A program, loaded and started.
fn run_program(bench: &mut Bench<Servo>, increments: &[i8]) {
    say(bench, Command::Download(increments.to_vec()));
    bench.send(&Command::Run.emit());
}

/// What was sent since the last call.
fn answers(bench: &mut Bench<Servo>) -> Vec<u8> {
    bench.run_ms(2);
    bench.sent.drain(..).map(|(_, byte)| byte).collect()
}

/// The events since the last call.
fn events(bench: &mut Bench<Servo>) -> Vec<String> {
    let events = bench.events();
    bench.outputs.retain(|(_, output)| !matches!(output, Output::Event { .. }));
    events
}

fn values<const N: usize>(bench: &Bench<Servo>, names: [&str; N]) -> [i64; N] {
    names.map(|name| bench.value(name))
}

#[test]
fn it_says_what_it_is() {
    let bench = servo(|settings| (settings.controller.kx, settings.controller.kv) = (20, 7));
    let description = bench.board.description();
    let signals: Vec<_> = description.signals.iter().map(|of| (of.name.as_str(), of.initial, of.role)).collect();
    let expected = [
        ("position_counts", 0, Role::Position),
        ("set_point_counts", 0, Role::SetPoint),
        ("error_counts", 0, Role::Error),
        ("drive", 0, Role::Drive),
        ("carriage_offset_counts", 0, Role::Offset),
        ("kx", 20, Role::Other),
        ("kv", 7, Role::Other),
        ("program_increments", 0, Role::Other),
        ("led_program", 0, Role::State),
        ("led_running", 0, Role::State),
        ("led_fault", 0, Role::State),
    ];
    assert_eq!(signals, expected);
    assert_eq!((description.ports.len(), description.events.len(), description.motors.len()), (1, 16, 1));
    assert_eq!(description.capabilities, [Capability::Reset]);
    assert_eq!(description.motors[0].capabilities, [Capability::Motor, Capability::Axis]);
    assert_eq!((bench.board.poll_timeout(), bench.board.mute(), bench.board.receivers().len()), (None, true, 1));
}

#[test]
fn it_confirms_the_link_and_the_gains_and_nothing_else() {
    let mut bench = servo(|_| ());
    for (command, expected) in [
        (Command::Link, &b"c"[..]),
        (Command::GetKx, &[16]),
        (Command::GetKv, &[0]),
        (Command::SetKx(200), &[]),
        (Command::SetKv(3), &[]),
        (Command::GetKx, &[200]),
        (Command::GetKv, &[3]),
        (Command::Home, &[]),
        (Command::Stop, &[]),
        (Command::Download(vec![1, 2, 3]), &[]),
    ] {
        say(&mut bench, command.clone());
        assert_eq!(answers(&mut bench), expected, "{command}");
    }
    assert_eq!(values(&bench, ["kx", "kv", "program_increments", "led_program"]), [200, 3, 3, 1]);
    assert_eq!(events(&mut bench), ["homed 0 counts from the 0 before", "program of 3 increments taken"]);
}

#[test]
fn what_is_no_command_is_an_event() {
    let mut bench = servo(|_| ());
    bench.send(b"q");
    assert_eq!(events(&mut bench), ["no command: 113"]);
    bench.send(b"X");
    bench.run_ms(60);
    assert_eq!(events(&mut bench), ["a command is cut short"]);
    bench.character(Character { framing_error: true, ..Character::good(0) });
    assert_eq!(events(&mut bench), ["line error"]);
    bench.run_ms(60);
    say(&mut bench, Command::Link);
    assert_eq!(answers(&mut bench), b"c");
}

#[test]
fn a_spoilt_download_leaves_no_program_and_a_spoilt_command_leaves_the_program() {
    let bad = Character { framing_error: true, ..Character::good(0) };
    type Spoil = fn(&mut Bench<Servo>, Character);
    let spoilt: [(Spoil, &str, i64); 6] = [
        (|bench, _| bench.send(b"D\x02\x00\x01"), "a download is cut short", 0),
        (|bench, _| bench.send(b"D\x01\x00\x01\x01"), "a download goes on behind its end", 0),
        (|bench, bad| (bench.send(b"D\x02"), bench.character(bad)).1, "line error", 0),
        (|bench, bad| bench.character(bad), "line error", 3),
        (|bench, _| bench.send(b"X"), "a command is cut short", 3),
        (|bench, _| bench.send(b"?"), "no command: 63", 3),
    ];
    for (spoil, event, left) in spoilt {
        let mut bench = servo(|_| ());
        say(&mut bench, Command::Download(vec![1, 2, 3]));
        events(&mut bench);
        spoil(&mut bench, bad);
        bench.run_ms(60);
        assert_eq!(events(&mut bench), [event]);
        assert_eq!(values(&bench, ["program_increments", "led_program"]), [left, i64::from(left > 0)], "{event}");
    }
}

#[test]
fn without_a_program_nothing_runs() {
    let mut bench = servo(|_| ());
    say(&mut bench, Command::Run);
    assert_eq!((events(&mut bench), bench.value("led_running")), (vec!["there is no program to run".to_owned()], 0));
}

#[test]
fn each_tick_moves_the_set_point_and_tells_of_the_error() {
    let mut bench = servo(|settings| settings.controller.kx = 0);
    run_program(&mut bench, &[3, 0, -1, 5]);
    assert_eq!(bench.value("led_running"), 1);
    let started = bench.now;
    bench.run_ms(24);
    // Without a gain the axis stands, so the error is the set point.
    assert_eq!(answers(&mut bench), [3, 3, 2, 7]);
    let history = bench.history("set_point_counts");
    let ticks: Vec<u64> = history[1..].iter().map(|(at, _)| at.as_nanos() / 1_000).collect();
    let first = started.as_nanos().div_ceil(5_000_000) * 5_000;
    assert_eq!(ticks, [first, first + 10_000, first + 15_000], "on the grid of its ticks");
    let set_points: Vec<i64> = history.iter().map(|(_, value)| *value).collect();
    assert_eq!(set_points, [0, 3, 2, 7]);
    let told = ["program of 4 increments taken", "run begins", "run over after 4 increments"];
    assert_eq!(events(&mut bench), told);
    assert_eq!(values(&bench, ["position_counts", "error_counts", "drive", "led_running"]), [0, 7, 0, 0]);
}

#[test]
fn the_error_on_the_line_is_the_low_byte() {
    let mut bench = servo(|settings| settings.controller.kx = 0);
    run_program(&mut bench, &[127, 127, 127]);
    bench.run_ms(20);
    assert_eq!(answers(&mut bench), [127, 254, 125]);
}

#[test]
fn during_motion_nothing_is_obeyed_but_a_stop() {
    let mut bench = servo(|_| ());
    run_program(&mut bench, &[1; 100]);
    bench.run_ms(10);
    events(&mut bench);
    assert!(!bench.board.mute());
    say(&mut bench, Command::SetKx(9));
    say(&mut bench, Command::Link);
    assert_eq!(events(&mut bench), ["dropped during motion: 'X'", "dropped during motion: 'C'"]);
    assert_eq!(bench.value("kx"), 16);
    bench.sent.clear();
    let at = bench.value("set_point_counts");
    bench.send(b"S");
    let told = events(&mut bench);
    assert!(told[0].starts_with("run stopped after ") && told.len() == 1, "{told:?}");
    let stopped = bench.value("set_point_counts");
    assert_eq!(told[0], format!("run stopped after {stopped} increments"));
    assert!((at..at + 2).contains(&stopped));
    bench.run_ms(300);
    assert_eq!(values(&bench, ["set_point_counts", "position_counts", "led_running"]), [stopped, stopped, 0]);
    assert!(bench.board.mute());
    say(&mut bench, Command::Stop);
    assert_eq!(events(&mut bench), [""; 0], "there is nothing to stop");
}

#[test]
fn a_download_that_is_spoilt_during_motion_leaves_the_program_that_runs() {
    let mut bench = servo(|_| ());
    run_program(&mut bench, &[1; 100]);
    bench.send(b"D\x05\x00\x01");
    bench.run_ms(70);
    assert!(events(&mut bench).contains(&"a download is cut short".to_owned()));
    assert_eq!(values(&bench, ["program_increments", "led_running"]), [100, 1]);
}

#[test]
fn the_drive_is_the_law_to_the_nearest_lsb() {
    // One increment from rest; the drive of that tick, before anything has moved.
    let drive = |kx: u8, kv: u8, dx: i8, full: u16, kv_on: KvOn| {
        let mut bench = servo(|settings| {
            (settings.controller.kx, settings.controller.kv, settings.controller.kv_on) = (kx, kv, kv_on);
            settings.drive.full = full;
        });
        run_program(&mut bench, &[dx]);
        bench.run_ms(5);
        bench.history("drive").get(1).map_or(0, |(_, drive)| *drive)
    };
    for (kx, kv, dx, full, kv_on, expected) in [
        (16, 0, 10, 127, KvOn::SetPoint, 10),
        (8, 0, 10, 127, KvOn::SetPoint, 5),
        (8, 0, 1, 127, KvOn::SetPoint, 1),
        (7, 0, 1, 127, KvOn::SetPoint, 0),
        (16, 16, 10, 127, KvOn::SetPoint, 20),
        (16, 16, 10, 127, KvOn::Position, 10),
        (255, 255, 127, 127, KvOn::SetPoint, 127),
        (255, 255, 127, 30, KvOn::SetPoint, 30),
        (0, 24, 5, 127, KvOn::SetPoint, 8),
    ] {
        assert_eq!(drive(kx, kv, dx, full, kv_on), expected, "{kx} {kv} {dx} {full} {kv_on:?}");
    }
}

#[test]
fn negative_drives_are_rounded_and_limited_as_positive_ones() {
    let mut bench = servo(|_| ());
    run_program(&mut bench, &[100; 20]);
    bench.run_ms(s(3));
    assert_eq!(values(&bench, ["position_counts", "error_counts", "drive"]), [2_000, 0, 0]);
    let drives: Vec<i64> = bench.history("drive").iter().map(|(_, drive)| *drive).collect();
    assert_eq!(drives.iter().max(), Some(&127));
    bench.outputs.clear();
    run_program(&mut bench, &[-100; 10]);
    bench.run_ms(s(3));
    let drives: Vec<i64> = bench.history("drive").iter().map(|(_, drive)| *drive).collect();
    assert_eq!((drives.iter().min(), bench.value("position_counts")), (Some(&-127), 1_000));
}

#[test]
fn damping_works_against_the_counts_of_the_last_tick() {
    let peak = |kv: u8| {
        let mut bench = servo(|settings| {
            (settings.controller.kx, settings.controller.kv, settings.controller.kv_on) = (60, kv, KvOn::Position);
        });
        run_program(&mut bench, &[127; 3]);
        bench.run_ms(2_000);
        bench.history("position_counts").iter().map(|(_, position)| *position).max().unwrap()
    };
    let (free, damped) = (peak(0), peak(120));
    assert!(free > damped + 10, "{free} {damped}");
}

#[test]
fn full_drive_is_full_speed() {
    let mut bench = servo(|_| ());
    bench.stimulus(MotorStimulus::Drive(1_000).of(0));
    bench.run_ms(1_000);
    let (from, at) = (bench.value("position_counts"), bench.now);
    bench.run_ms(1_000);
    let way = (bench.value("position_counts") - from) as f64;
    let ticks = bench.now.since(at).as_secs_f64() / 0.005;
    assert!((way - ticks * FULL).abs() < 0.001 * way, "{way}");
    assert_eq!(bench.value("drive"), 127);
    // Half of 127, rounded; the loop stays open, and a reset ends the service mode.
    bench.stimulus(MotorStimulus::Drive(-500).of(0));
    assert_eq!(bench.value("drive"), -64);
    bench.stimulus(MotorStimulus::Drive(0).of(0));
    assert_eq!(bench.value("drive"), 0);
    bench.stimulus(MotorStimulus::Drive(300).of(0));
    bench.stimulus(Stimulus::Reset);
    assert_eq!(bench.value("drive"), 0);
    bench.run_ms(1_000);
    let stands = bench.value("position_counts");
    bench.run_ms(1_000);
    assert_eq!((bench.value("position_counts"), bench.board.poll_timeout()), (stands, None));
    assert_eq!(bench.value("set_point_counts"), stands, "an open loop's set point is where the axis is");
}

#[test]
fn the_set_point_never_leaves_the_travel() {
    let mut bench = servo(|_| ());
    run_program(&mut bench, &[10, 10, -15, -6, 1]);
    bench.run_ms(500);
    assert_eq!(values(&bench, ["set_point_counts", "position_counts", "led_running", "led_fault"]), [5, 5, 0, 0]);
    assert_eq!(events(&mut bench)[2], "end of travel after 3 increments");
    assert_eq!(answers(&mut bench).len(), 3, "telemetry stops");
    // At the other end.
    let ticks = usize::try_from(TRAVEL / 10 + 10).unwrap();
    run_program(&mut bench, &vec![10; ticks]);
    bench.run_ms(s(28));
    let end = 5 + (TRAVEL - 5) / 10 * 10;
    assert_eq!(values(&bench, ["set_point_counts", "position_counts", "led_fault"]), [end, end, 0]);
    assert_eq!(events(&mut bench)[2], format!("end of travel after {} increments", (TRAVEL - 5) / 10));
    // The last count of the travel belongs to it.
    let rest = i8::try_from(TRAVEL - end).unwrap();
    run_program(&mut bench, &[rest, 1]);
    bench.run_ms(500);
    assert_eq!(bench.value("position_counts"), TRAVEL);
    assert_eq!(events(&mut bench)[2], "end of travel after 1 increments");
}

#[test]
fn a_hard_stop_opens_the_loop() {
    let mut bench = servo(|_| ());
    // It has lost its place: what it takes for 0 is 300 counts beyond the true end.
    bench.stimulus(MotorStimulus::Drive(1_000).of(0));
    bench.run_ms(200);
    bench.stimulus(MotorStimulus::Drive(0).of(0));
    bench.run_ms(500);
    let away = bench.value("position_counts");
    say(&mut bench, Command::Home);
    assert_eq!(events(&mut bench), [format!("homed {away} counts from the 0 before")]);
    assert_eq!(values(&bench, ["position_counts", "set_point_counts", "carriage_offset_counts"]), [0; 3]);
    bench.stimulus(MotorStimulus::Drive(-1_000).of(0));
    bench.run_ms(s(2));
    bench.stimulus(MotorStimulus::Drive(0).of(0));
    bench.run_ms(100);
    // 1 mm beyond the end.
    let end = -away - 125;
    assert!((bench.value("position_counts") - end).abs() <= 1);
    // From out there the program may come back, but not go on.
    run_program(&mut bench, &[-1]);
    bench.run_ms(50);
    assert_eq!(events(&mut bench)[2], "end of travel after 0 increments");
    run_program(&mut bench, &[50, -20]);
    bench.run_ms(300);
    let told = events(&mut bench);
    assert_eq!(told[2], "end of travel after 1 increments");
    assert!((bench.value("position_counts") - end - 50).abs() <= 1);
    assert_eq!(values(&bench, ["led_fault", "drive", "error_counts"]), [0; 3]);
}

#[test]
fn beyond_the_travel_a_program_may_rest() {
    for drive in [1_000, -1_000] {
        let mut bench = servo(|settings| settings.plant.travel_mm = 10.0);
        bench.stimulus(MotorStimulus::Drive(drive).of(0));
        bench.run_ms(s(2));
        bench.stimulus(MotorStimulus::Drive(0).of(0));
        assert!(!(0..=1_250).contains(&bench.value("position_counts")));
        run_program(&mut bench, &[0, 0]);
        bench.run_ms(50);
        assert_eq!(events(&mut bench)[2], "run over after 2 increments");
    }
}

#[test]
fn driven_into_a_hard_stop_it_gives_up() {
    let mut bench = servo(|settings| settings.plant.travel_mm = 10.0);
    // The encoder loses counts on the way out, so the end comes too early.
    run_program(&mut bench, &[30; 10]);
    bench.run_ms(500);
    bench.stimulus(MotorStimulus::Counts(-250).of(0));
    bench.run_ms(500);
    events(&mut bench);
    run_program(&mut bench, &[30; 30]);
    bench.run_ms(s(1));
    assert_eq!(events(&mut bench)[3], "gives up: driven into a hard stop");
    assert_eq!(values(&bench, ["led_fault", "led_running", "drive", "error_counts"]), [1, 0, 0, 0]);
    bench.run_ms(s(1));
    // The next run closes the loop where the axis stands.
    let at = bench.value("position_counts");
    run_program(&mut bench, &[-20]);
    bench.run_ms(s(1));
    assert_eq!(values(&bench, ["led_fault", "position_counts"]), [0, at - 20]);
}

#[test]
fn a_following_error_beyond_its_limit_opens_the_loop() {
    for (increments, gives_up) in [(vec![100; 5], false), (vec![100, 100, 100, 100, 100, 1], true)] {
        let mut bench = servo(|settings| settings.controller.error_max_counts = 500);
        bench.stimulus(MotorStimulus::Stall(true).of(0));
        run_program(&mut bench, &increments);
        bench.run_ms(200);
        let told = events(&mut bench);
        assert_eq!(told.contains(&"gives up: following error of 501 counts".to_owned()), gives_up, "{told:?}");
        let expected = if gives_up { [1, 0, 0] } else { [0, 500, 127] };
        assert_eq!(values(&bench, ["led_fault", "error_counts", "drive"]), expected);
        bench.stimulus(MotorStimulus::Stall(false).of(0));
        bench.run_ms(s(1));
        assert_eq!(bench.value("position_counts"), if gives_up { 0 } else { 500 });
    }
}

#[test]
fn a_reset_opens_the_loop_and_forgets_the_program_and_the_gains() {
    let mut bench = servo(|_| ());
    say(&mut bench, Command::SetKx(30));
    say(&mut bench, Command::SetKv(5));
    run_program(&mut bench, &[20; 50]);
    bench.run_ms(100);
    events(&mut bench);
    bench.stimulus(Stimulus::Reset);
    assert!(bench.outputs.iter().any(|(_, output)| *output == Output::Cut { port: 0 }));
    assert_eq!(events(&mut bench), ["reset"]);
    let names = ["kx", "kv", "program_increments", "led_program", "led_running", "led_fault", "drive", "error_counts"];
    assert_eq!(values(&bench, names), [16, 0, 0, 0, 0, 0, 0, 0]);
    bench.sent.clear();
    let before = bench.value("position_counts");
    bench.run_ms(s(1));
    let coasted = bench.value("position_counts");
    assert!(coasted > before, "{before} {coasted}");
    assert_eq!(bench.value("set_point_counts"), coasted);
    assert_eq!((answers(&mut bench), bench.board.poll_timeout()), (vec![], None));
}

#[test]
fn with_its_supply_it_loses_its_place() {
    let mut bench = servo(|settings| settings.plant.backlash_mm = 0.4);
    run_program(&mut bench, &[50; 10]);
    bench.run_ms(s(1));
    assert_eq!(bench.value("position_counts"), 500);
    // What the motor overshot and came back; the carriage did not.
    let offset = bench.value("carriage_offset_counts");
    assert!((1..=20).contains(&offset), "{offset}");
    bench.stimulus(Stimulus::Power(false));
    bench.stimulus(Stimulus::Power(true));
    assert_eq!(values(&bench, ["position_counts", "set_point_counts", "carriage_offset_counts"]), [0; 3]);
    // On again, and back: the carriage stands until the gap of 50 counts is taken up.
    run_program(&mut bench, &[[1; 30], [0; 30], [-1; 30]].concat());
    bench.run_ms(s(1));
    assert_eq!(bench.value("position_counts"), 0);
    let back = bench.value("carriage_offset_counts");
    assert!((30 - offset..33 - offset).contains(&back), "{offset} {back}");
}

#[test]
fn what_happens_to_the_plant_reaches_it() {
    let way = |stimulus: Option<Stimulus>| {
        let mut bench = servo(|_| ());
        stimulus.into_iter().for_each(|stimulus| bench.stimulus(stimulus));
        bench.stimulus(MotorStimulus::Drive(1_000).of(0));
        bench.run_ms(s(1));
        bench.value("position_counts")
    };
    let free = way(None);
    assert!((way(Some(MotorStimulus::Supply(500).of(0))) * 2 - free).abs() <= 2);
    assert!((way(Some(MotorStimulus::Load(250).of(0))) - free * 3 / 4).abs() <= 2);
    assert_eq!(way(Some(MotorStimulus::Stall(true).of(0))), 0);
    let stop = i32::try_from(300 - TRAVEL / 2).unwrap();
    assert_eq!(way(Some(MotorStimulus::EndStop(stop).of(0))), free, "one on the side of the start lies behind it");
    assert_eq!(way(Some(MotorStimulus::Stall(true).of(1))), free, "it has one motor only");
}

#[test]
fn counts_that_are_lost_are_missing_in_the_sense_of_the_motion() {
    for (drive, counts, offset) in [(500, 7, -7), (500, -7, 7), (-500, 7, 7)] {
        let mut bench = servo(|_| ());
        bench.stimulus(MotorStimulus::Drive(1_000).of(0));
        bench.run_ms(500);
        bench.stimulus(MotorStimulus::Drive(drive).of(0));
        bench.run_ms(200);
        bench.stimulus(MotorStimulus::Counts(counts).of(0));
        bench.run_ms(100);
        assert_eq!(bench.value("carriage_offset_counts"), offset, "{drive} {counts}");
    }
}

#[test]
fn what_moves_without_being_driven_is_followed() {
    let mut bench = servo(|settings| settings.plant.load_torque = -0.1);
    assert!(bench.board.poll_timeout().is_some());
    bench.run_ms(s(1));
    // A tenth of full speed, less the time to get there.
    assert!((190..=210).contains(&bench.value("position_counts")));
    // Held by the loop, it hangs on its error.
    let mut bench = servo(|settings| settings.plant.load_torque = -0.1);
    run_program(&mut bench, &[1]);
    bench.run_ms(s(2));
    let error = bench.value("error_counts");
    assert!((-14..=-12).contains(&error), "{error}");
}

#[test]
fn another_clock_changes_its_ticks_and_its_line() {
    let mut bench = servo(|settings| settings.controller.kx = 0);
    bench.stimulus(Stimulus::Clock(Clock::from_ppb(100_000_000).unwrap()));
    bench.send(b"D\x64\x00");
    bench.send(&[1; 100]);
    bench.run_ms(3);
    bench.send(b"R");
    bench.run_ms(s(1));
    let history = bench.history("set_point_counts");
    let ticks: Vec<u64> = history[2..].windows(2).map(|two| two[1].0.since(two[0].0).as_nanos()).collect();
    assert!(ticks.iter().all(|tick| tick.abs_diff(4_545_454) <= 1), "{ticks:?}");
    let character = |(_, output): &(Instant, Output)| match output {
        Output::Character { edges, end, .. } => Some(end.since(edges[0].at)),
        _ => None,
    };
    let characters: Vec<Span> = bench.outputs.iter().filter_map(character).collect();
    assert_eq!(characters.len(), 100);
    assert!(characters.iter().all(|length| length.as_nanos().abs_diff(946_970) <= 1), "{characters:?}");
}

#[test]
fn it_waits_for_the_silence_in_a_command_and_for_its_ticks() {
    let mut bench = servo(|_| ());
    bench.send(b"X");
    let deadline = bench.board.poll_timeout().unwrap();
    assert_eq!((deadline.at, bench.board.silence()), (bench.now + GAP, Some(bench.now + GAP)));
    bench.send(&[16]);
    assert_eq!((bench.board.poll_timeout(), bench.board.silence()), (None, None));
    run_program(&mut bench, &[1; 10]);
    let tick = bench.board.poll_timeout().unwrap().at;
    assert_eq!(tick.as_nanos() % 5_000_000, 0);
    assert!(!bench.board.mute());
    bench.run_ms(s(1));
    assert_eq!((bench.board.poll_timeout(), bench.board.mute()), (None, true), "at rest");
}
