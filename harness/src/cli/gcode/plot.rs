//! `torno gcode plot`

use std::path::PathBuf;
use std::process::ExitCode;

use torno::observe::stderr::say;
use torno::toolpath::{Asked, Picture, stairs};
use torno_machines::workpiece::ToolPath;
use torno_plot::Colours;

use super::plan::{Plan, Planning, play};
use super::reading::Reading;
use crate::cli::options::picture;
use crate::cli::{INTERRUPTED, Interrupt, USAGE, draw};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    planning: Planning,
    /// Where to draw it (.svg or .png) [default: SVG on standard output]
    #[arg(short, long, value_name = "FILE", value_parser = picture, default_value = "-", hide_default_value = true)]
    output: PathBuf,
    /// Draws only what the program asks for, whether it can be planned or not
    #[arg(long)]
    asked: bool,
}

impl Arguments {
    pub(super) async fn run(self) -> anyhow::Result<ExitCode> {
        let Self { reading, planning, output, asked: only_asked } = self;
        let file = planning.rig()?;
        let Some(part) = &file.part else {
            anyhow::bail!("the rig '{}' turns no part: expected a [part] in its file", file.name);
        };
        let at = part.place(0, 0);
        let start = reading.start().unwrap_or(at);
        let mut asked = Asked::new(at, start);
        let (mut frames, mut turned) = (Vec::new(), None);
        if only_asked {
            let settings = planning.settings(&reading, start);
            let outcome = reading.interpret(&settings, &mut reading.open()?, &mut |motion| asked.take(&motion))?;
            say(&outcome.findings.iter().map(|finding| reading.told(finding)).collect::<String>());
            if outcome.is_refused() {
                return Ok(ExitCode::from(USAGE));
            }
        } else {
            let plan = Plan::new(&reading, &file, &planning, |motion| asked.take(motion))?;
            say(&plan.told(&reading));
            if plan.is_refused() {
                return Ok(ExitCode::from(USAGE));
            }
            let mut interrupt = Interrupt::listen()?;
            let Some(mut played) = play(&file, &plan.program, &mut interrupt).await? else {
                return Ok(ExitCode::from(INTERRUPTED));
            };
            frames = stairs(part, &plan.program);
            turned = played.path.take().map(ToolPath::cut);
        }
        let turned = turned.as_ref().map(|turned| &turned.profile);
        let name = reading.name();
        let picture = Picture { title: &name, asked: &asked, part, stairs: &frames, turned };
        draw(&output, &picture.figure(), &Colours::default())?;
        Ok(ExitCode::SUCCESS)
    }
}
