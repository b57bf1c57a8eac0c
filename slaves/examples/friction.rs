//! What friction and load do to the three loops that have a drive of more than on and off:
//! `cargo run --release -p torno-slaves --example friction` prints tables, with `svg` behind it a picture,
//! with `moves` the tables of single moves alone.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "an example")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::Bench;
use common::envelope::{Feed, LOADS, Move, Verdict, against, frictions, plain, play, programs, told_within};
use torno_protocol::board::{Board, MotorStimulus, Output};
use torno_protocol::clock::Clock;
use torno_protocol::lathe::{ACK, CAN};
use torno_protocol::servo::Command;
use torno_slaves::{Servo, ServoSettings, Spindle, SpindleSettings, TransverseSettings};

/// The laws of the feed axis that are compared.
fn laws() -> Vec<(&'static str, TransverseSettings)> {
    let with = |change: &dyn Fn(&mut TransverseSettings), mut settings: TransverseSettings| {
        change(&mut settings);
        settings
    };
    let k2 = |k2: f64| {
        with(&|settings| settings.controller.k2_standing = k2, {
            with(&|settings| settings.controller.k2 = k2, plain())
        })
    };
    let now = TransverseSettings::default;
    vec![
        ("before: K2 0.5", plain()),
        ("before: K2 2", k2(2.0)),
        ("before: K2 5", k2(5.0)),
        ("before: K2 10", k2(10.0)),
        ("now, without breakaway", with(&|settings| settings.controller.breakaway = 0.0, now())),
        ("now, without dead band", with(&|settings| settings.controller.dead_band_counts = 0, now())),
        ("now, without waiting", with(&|settings| settings.controller.wait_counts = 0, now())),
        ("now", now()),
    ]
}

/// One letter for a program: good, false stall, hunting, off.
fn letter(verdict: &Verdict) -> char {
    match verdict {
        verdict if verdict.is_good() => '.',
        Verdict { stalls: 0, lost: 0, hunts: 0, .. } => 'o',
        Verdict { stalls: 0, lost: 0, .. } => 'h',
        _ => 'S',
    }
}

fn row(settings: &TransverseSettings, moves: &[Move], load: f64) -> Vec<Verdict> {
    frictions().map(|friction| play(&against(settings, friction, load), moves)).collect()
}

fn feed() {
    println!("feed axis; for each load friction from 0 to 12 % in steps of 0.5 %");
    println!(". good, S false stall, h hunting, o off; rest: moves off for a while in the second after their ACK");
    for (name, settings) in laws() {
        println!("\n{name}");
        println!(
            "{:13}  {:25} {:25} {:25} good  rest  overshoot  lag",
            "program", "load 0", "load +15 %", "load -15 %"
        );
        for (program, moves) in programs() {
            let rows = LOADS.map(|load| row(&settings, &moves, load));
            let letters = rows.clone().map(|row| row.iter().map(letter).collect::<String>()).join(" ");
            let all = rows.concat();
            let good = all.iter().filter(|verdict| verdict.is_good()).count();
            let rest: usize = all.iter().map(|verdict| verdict.restless).sum();
            let most = |of: fn(&Verdict) -> i64| all.iter().map(of).max().unwrap();
            let (overshoot, lag) = (most(|verdict| verdict.overshoot), most(|verdict| verdict.lag));
            println!("{program:13} {letters}  {good:2}/75 {rest:5} {overshoot:10} {lag:4}");
        }
        for (program, moves) in programs() {
            let Verdict { seconds, overshoot, lag, .. } = play(&settings, &moves);
            println!("{program:13} without friction and load: {seconds:.2} s, overshoot {overshoot}, lag {lag}");
        }
        println!("blocked at any sample of several moves: told within {:.2} s", told_within(&settings));
    }
}

/// Friction and load of the cells that are shown one by one.
const CELLS: [(f64, f64); 8] =
    [(0.0, 0.0), (0.02, 0.0), (0.05, 0.0), (0.12, 0.0), (0.0, 0.15), (0.0, -0.15), (0.12, 0.15), (0.12, -0.15)];

/// One move of the feed over the envelope, with the law as it was and as it is.
fn feed_move() {
    println!("\nfeed axis: 9000 counts at 112 a sample; settling is from the end of the set point's way on");
    println!("friction  load   law     settling  overshoot  steady error  verdict       blocked: CAN after");
    let step = Move { speed: 112, way: 9_000 };
    for (friction, load) in CELLS {
        for (name, law) in [("before", plain()), ("now", TransverseSettings::default())] {
            let settings = against(&law, friction, load);
            let mut feed = Feed::new(&settings);
            feed.start(step);
            let (mut path, mut reply, mut replied) = (Vec::new(), None, 0_usize);
            for n in 0..1_500 {
                path.push(feed.sample());
                if reply.is_none() {
                    reply = feed.reply();
                    replied = n;
                }
                if reply.is_some() && n > replied + 200 {
                    break;
                }
            }
            let last = if reply == Some(CAN) { replied.saturating_sub(1) } else { path.len() - 1 };
            let arrives = path.iter().position(|[_, set_point, ..]| *set_point == step.way).unwrap_or(last);
            let out = path[..=last].iter().rposition(|[at, ..]| (at - step.way).abs() > 1).unwrap_or(0);
            let settled = (out < last).then(|| (out + 1).saturating_sub(arrives) as f64 * 0.030);
            let over = path[..=last].iter().map(|[at, ..]| at - step.way).max().unwrap_or(0).max(0);
            let verdict = match reply {
                Some(ACK) if out > replied + 34 => "hunts",
                Some(ACK) => "done",
                Some(_) => "false stall",
                None => "busy",
            };
            let mut blocked = Feed::new(&settings);
            blocked.start(step);
            (0..60).for_each(|_| _ = blocked.sample());
            blocked.bench.stimulus(MotorStimulus::Stall(true).of(0));
            let from = blocked.bench.now;
            let told = (blocked.replies_within(333) == Some(CAN)).then(|| blocked.bench.now.since(from).as_secs_f64());
            let seconds = |of: Option<f64>| of.map_or("never".to_owned(), |of| format!("{of:.2} s"));
            let error = step.way - path[last][0];
            println!(
                "{friction:<9} {load:<6} {name:<7} {:<9} {over:<10} {error:<13} {verdict:<13} {}",
                seconds(settled),
                seconds(told)
            );
        }
    }
}

/// The last value of a quantity in each of so many spans of 30 ms.
fn watch<B: Board>(bench: &mut Bench<B>, signal: u8, spans: usize, mut last: i64) -> Vec<i64> {
    let span = |_| {
        bench.run_ms(30);
        for (_, output) in bench.outputs.drain(..) {
            match output {
                Output::Telemetry { signal: of, value } if of == signal => last = value,
                _ => {}
            }
        }
        last
    };
    (0..spans).map(span).collect()
}

fn spindle() {
    println!("\nmain motor: from rest; the mean of the last of 60 s; blocked while it starts, and while it regulates");
    println!("friction  load  rpm   ACK after  overshoot  mean     CAN after");
    for (friction, load) in [(0.0, 0.0), (0.03, 0.0), (0.06, 0.0), (0.12, 0.0), (0.0, 0.15), (0.06, 0.15), (0.12, 0.15)]
    {
        for rpm in [200_u16, 1_500, 4_000] {
            let mut settings = SpindleSettings::default();
            (settings.plant.friction, settings.plant.load_torque) = (friction, load);
            let mut bench = Bench::new(Spindle::new(&settings, Clock::TRUE));
            bench.send(&[u8::try_from(rpm / 20).unwrap()]);
            let blocked = |bench: &Bench<Spindle>| {
                let mut bench = bench.clone();
                bench.sent.clear();
                bench.stimulus(MotorStimulus::Stall(true).of(0));
                let from = bench.now;
                watch(&mut bench, 1, 600, 0);
                let told = bench.sent.iter().find(|(_, byte)| *byte == CAN);
                told.map_or("never".to_owned(), |(at, _)| format!("{:.2}", at.since(from).as_secs_f64()))
            };
            let mut speeds = watch(&mut bench, 1, 20, 0);
            let start = blocked(&bench);
            speeds.extend(watch(&mut bench, 1, 1_980, speeds[19]));
            let ack = bench.sent.iter().find(|(_, byte)| *byte == ACK);
            let ack = ack.map_or("never".to_owned(), |(at, _)| format!("{:.2} s", at.as_secs_f64()));
            let mean = speeds[1_966..].iter().sum::<i64>() as f64 / 34.0;
            let over = speeds.iter().max().unwrap() - i64::from(rpm);
            let regulated = blocked(&bench);
            println!("{friction:<9} {load:<5} {rpm:<5} {ack:10} {over:<10} {mean:<8.1} {start} s, {regulated} s");
        }
    }
}

fn stand() {
    println!("\nservo stand: 10 mm/s for 2 s and rest, Kx 20; the error in counts of 8 um a second after");
    println!("Kv   friction  load   settling  overshoot  error  at most  verdict  blocked after 1 s: gives up after");
    for kv in [0, 195] {
        for (friction, load) in
            [(0.0, 0.0), (0.02, 0.0), (0.06, 0.0), (0.12, 0.0), (0.0, 0.15), (0.12, 0.15), (0.12, -0.15)]
        {
            let mut settings = ServoSettings::default();
            (settings.plant.friction, settings.plant.load_torque) = (friction, load);
            (settings.controller.kx, settings.controller.kv) = (20, kv);
            let mut bench = Bench::as_switched_on(Servo::new(&settings, Clock::TRUE));
            // 1250 counts/s are 6.25 a tick of 5 ms.
            let increments: Vec<i8> = (0..400).map(|n| if n % 4 == 0 { 7 } else { 6 }).collect();
            bench.send(&Command::Download(increments).emit());
            bench.run_ms(10);
            bench.send(&Command::Run.emit());
            let mut errors = watch(&mut bench, 2, 34, 0);
            let mut blocked = bench.clone();
            blocked.stimulus(MotorStimulus::Stall(true).of(0));
            let lamp = watch(&mut blocked, 10, 200, 0).iter().position(|lamp| *lamp == 1);
            let gives_up = lamp.map_or("never".to_owned(), |n| format!("{:.2} s", (n + 1) as f64 * 0.030));
            let before = errors[33];
            errors.extend(watch(&mut bench, 2, 66, before));
            let most = errors.iter().map(|error| error.abs()).max().unwrap();
            let last = errors[99];
            // The run takes 66.7 spans.
            let out = errors.iter().rposition(|error| (error - last).abs() > 1).unwrap_or(0);
            let settled = out.saturating_sub(66) as f64 * 0.030;
            let over = errors[66..].iter().map(|error| -error).max().unwrap().max(0);
            let verdict = if last.abs() <= 1 { "done" } else { "stands off" };
            println!(
                "{kv:<4} {friction:<9} {load:<6} {settled:.2} s    {over:<10} {last:<6} {most:<8} {verdict:<10} \
                 {gives_up}"
            );
        }
    }
}

/// A move of 5400 counts at 5 %: per sample, seconds after the set point has arrived, and the error.
fn arrival(settings: &TransverseSettings) -> Vec<(f64, i64)> {
    let mut feed = Feed::new(&against(settings, 0.05, 0.0));
    feed.start(Move { speed: 60, way: 5_400 });
    let samples = (0..400).map(|_| feed.sample()).skip_while(|[_, set_point, ..]| *set_point < 5_400);
    samples.take(84).enumerate().map(|(n, [at, ..])| (n as f64 * 0.030, 5_400 - at)).collect()
}

fn picture() {
    let colour = |letter| match letter {
        '.' => "#7fbf7b",
        'o' => "#f6d55c",
        'h' => "#f28e2b",
        _ => "#c23b3b",
    };
    println!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='780' height='640' font-family='sans-serif' font-size='12'>"
    );
    println!("<rect width='780' height='640' fill='white'/>");
    println!(
        "<text x='20' y='22' font-size='15'>The feed axis against friction (0 to 12 %) and load (0, +15, -15 %)</text>"
    );
    for (n, (name, fill)) in
        [("as it should", '.'), ("false stall", 'S'), ("hunts", 'h'), ("off", 'o')].into_iter().enumerate()
    {
        let x = 190 + 120 * n;
        println!(
            "<rect x='{x}' y='32' width='12' height='12' fill='{}'/><text x='{}' y='43'>{name}</text>",
            colour(fill),
            x + 18
        );
    }
    for (n, (name, settings)) in laws().into_iter().enumerate() {
        let y = 56 + 46 * n;
        println!("<text x='20' y='{}'>{name}</text>", y + 22);
        for (m, (_, moves)) in programs().iter().enumerate() {
            for (l, load) in LOADS.into_iter().enumerate() {
                let letters: Vec<char> = row(&settings, moves, load).iter().map(letter).collect();
                let mut f = 0;
                for run in letters.chunk_by(|a, b| a == b) {
                    let (x, y, wide) = (190 + 185 * l + 7 * f, y + 13 * m, 7 * run.len());
                    println!("<rect x='{x}' y='{y}' width='{wide}' height='11' fill='{}'/>", colour(run[0]));
                    f += run.len();
                }
            }
        }
    }
    let key = "In each block, from above: demonstration, short moves, long moves. From left: load 0, +15, -15 %.";
    println!("<text x='20' y='446'>{key}</text>");
    let title = "5400 counts with 5 % friction: the error after the set point has arrived";
    println!("<text x='20' y='476' font-size='15'>{title}</text>");
    for counts in [0, 10, 20] {
        let y = 610 - 5 * counts;
        println!("<path d='M60 {y}H740' stroke='#ddd'/><text x='20' y='{}'>{counts}</text>", y + 4);
    }
    for tenths in 0..=5 {
        println!("<text x='{}' y='630'>{:.1} s</text>", 60 + 136 * tenths - 8, f64::from(tenths) * 0.5);
    }
    for (settings, stroke, name, x) in
        [(plain(), "#c23b3b", "before", 560), (TransverseSettings::default(), "#2b7a2b", "now", 640)]
    {
        let point = |(t, error): &(f64, i64)| format!("{:.1} {:.1}", 60.0 + 272.0 * t, 610.0 - 5.0 * *error as f64);
        let path = arrival(&settings).iter().map(point).collect::<Vec<_>>().join(" L");
        println!("<path d='M{path}' fill='none' stroke='{stroke}' stroke-width='2'/>");
        println!("<text x='{x}' y='500' fill='{stroke}'>{name}</text>");
    }
    println!("</svg>");
}

fn main() {
    if std::env::args().any(|argument| argument == "svg") {
        return picture();
    }
    if std::env::args().any(|argument| argument == "moves") {
        feed_move();
        spindle();
        return stand();
    }
    feed();
    feed_move();
    spindle();
    stand();
}
