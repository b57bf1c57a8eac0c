//! `torno servo contour`

use std::path::PathBuf;
use std::process::ExitCode;

use serde_json::json;
use torno::servo::contour::{self, Contour};
use torno_servo::contour::{Shape, Task};

use super::{Paint, RIG, draw, load_rig, print_beside};
use crate::cli::options::{picture, time};

/// A path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Track {
    /// A right angle.
    Corner,
    /// At 45 degrees.
    Line,
    /// Two turns.
    Circle,
    /// To a point, each axis by itself.
    Points,
    /// To the same point, in a straight line.
    Straight,
}

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The paths [default: all]
    #[arg(value_enum)]
    paths: Vec<Track>,
    /// The speed along the path, in mm/s
    #[arg(long, default_value_t = 10.0, value_name = "MM/S", value_parser = speed)]
    speed: f64,
    /// The circle's radius, in mm
    #[arg(long, default_value_t = 10.0, value_name = "MM", value_parser = radius)]
    radius: f64,
    /// Kx of the axis x: 1 to 255
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    kx: u8,
    /// Kx of the axis y: 1 to 255
    #[arg(long, default_value_t = 18, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    kx_of_y: u8,
    /// The motors' time constant: 1 ms to 200 ms
    #[arg(long, default_value = "30 ms", value_name = "TIME", value_parser = tau)]
    tau: f64,
    /// Draws the paths (.svg or .png)
    #[arg(short = 'o', long, alias = "out", value_name = "FILE", value_parser = picture)]
    plot: Option<PathBuf>,
    #[command(flatten)]
    paint: Paint,
    /// Prints the result as one line of JSON
    #[arg(long)]
    json: bool,
}

fn within(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| (least..=most).contains(value));
    value.ok_or_else(|| format!("expected {least} to {most}"))
}

fn speed(text: &str) -> Result<f64, String> {
    within(text, 0.1, 15.0)
}

fn radius(text: &str) -> Result<f64, String> {
    within(text, 0.5, 100.0)
}

fn tau(text: &str) -> Result<f64, String> {
    let tau = time(text)?.as_secs_f64();
    if (0.001..=0.2).contains(&tau) { Ok(tau) } else { Err("expected 1 ms to 200 ms".to_owned()) }
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let file = load_rig(RIG, &[format!("servo.plant.tau_s={}", self.tau)])?;
        let all = [Track::Corner, Track::Line, Track::Circle, Track::Points, Track::Straight];
        let paths = if self.paths.is_empty() { &all[..] } else { &self.paths };
        let mut contours = Vec::new();
        for path in paths {
            let shape = match path {
                Track::Corner => Shape::Corner,
                Track::Line => Shape::Line(45.0),
                Track::Circle => Shape::Circle(self.radius),
                Track::Points => Shape::Points,
                Track::Straight => Shape::Straight,
            };
            // Like axes show what the path does to them, unlike ones what they do to a line.
            let alike = matches!(path, Track::Corner | Track::Circle);
            let kx = [self.kx, if alike { self.kx } else { self.kx_of_y }];
            let task = Task { shape, speed_mm_s: self.speed };
            contours.push(contour::drive(&file, task, kx, self.tau).await?);
        }
        if let Some(path) = &self.plot {
            draw(path, &contour::figure(&contours), &self.paint.colours())?;
        }
        let of = |contour: &Contour| {
            let Contour { measured, sampled, predicted, .. } = contour;
            json!({
                "path": contour.name(),
                "deviation_mm": measured,
                "sampled_mm": sampled,
                "formula_mm": predicted,
            })
        };
        let text = if self.json {
            format!("{}\n", serde_json::Value::from(contours.iter().map(of).collect::<Vec<_>>()))
        } else {
            contours.iter().map(Contour::text).collect()
        };
        print_beside(&[&self.plot], &text)?;
        Ok(ExitCode::SUCCESS)
    }
}
