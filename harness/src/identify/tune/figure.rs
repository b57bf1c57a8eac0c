//! A proposal, as a picture.

use torno_plot::{Figure, Panel, Series, Style as Drawn};

use super::Tuning;
use super::forecast::small_step;
use super::rig::Seen;

impl Tuning {
    /// What was seen on the rig, and what was foretold; without a rig, the response to a small step.
    pub fn figure(&self) -> Figure {
        let panel = |y: &str, height: f64, series: Vec<Series>| Panel {
            x: "time, s".to_owned(),
            y: y.to_owned(),
            height,
            series,
        };
        let title = format!("{}: {}", self.motor.subject, self.controller);
        let (Some(shown), Some(present)) = (&self.shown, &self.shown_present) else {
            let (model, period) = (self.motor.result.model(), self.motor.period_s);
            let open = self.controller.open_loop(&model, period);
            let points = small_step(&open, &model);
            let settled = self.forecast.small_step.map_or(f64::MAX, |step| 2.0 * step.settling_s);
            let points = points.into_iter().filter(|(t, _)| *t <= settled).collect();
            return Figure {
                title,
                panels: vec![panel("share of a small step", 1.0, vec![Series::new("response", Drawn::Line, points)])],
            };
        };
        let last = self.last_change();
        let until = |points: &[(f64, f64)]| points.iter().copied().filter(|(t, _)| *t <= last).collect::<Vec<_>>();
        let mut panels = Vec::new();
        let mut paths = vec![
            Series::new("proposed", Drawn::Line, until(&shown.path)),
            Series::new("as it is", Drawn::Line, until(&present.path)),
        ];
        let open = self.shown_open.as_ref();
        if self.motor.axis {
            paths.push(Series::new("set point", Drawn::Dashed, until(&shown.wanted)));
            panels.push(panel("position, counts", 0.8, paths));
            let lag = |seen: &Seen| {
                let pairs = seen.wanted.iter().zip(&seen.path);
                until(&pairs.map(|((t, wanted), (_, y))| (*t, wanted - y)).collect::<Vec<_>>())
            };
            let lags = vec![
                Series::new("proposed", Drawn::Line, lag(shown)),
                Series::new("as it is", Drawn::Line, lag(present)),
            ];
            panels.push(panel("following error, counts", 0.6, lags));
        } else {
            paths.extend(open.map(|open| Series::new("open loop", Drawn::Line, until(&open.path))));
            paths.push(Series::new("foretold", Drawn::Dashed, until(&self.foretold_path)));
            paths.push(Series::new("set point", Drawn::Dashed, until(&shown.wanted)));
            panels.push(panel("speed, rpm", 1.0, paths));
        }
        let mut drives = vec![
            Series::new("proposed", Drawn::Steps, until(&shown.drive)),
            Series::new("as it is", Drawn::Steps, until(&present.drive)),
        ];
        drives.extend(open.map(|open| Series::new("open loop", Drawn::Steps, until(&open.drive))));
        panels.push(panel("drive, LSB", 0.5, drives));
        Figure { title, panels }
    }

    /// Some time after which nothing changes any more, in s.
    fn last_change(&self) -> f64 {
        let seen = [&self.shown, &self.shown_present, &self.shown_open].into_iter().flatten();
        let last = seen.filter_map(|seen| {
            let (_, end) = *seen.path.last()?;
            let out = seen.path.iter().rposition(|(_, y)| (y - end).abs() > 0.02 * end.abs().max(1.0))?;
            Some(seen.path[out].0)
        });
        1.5 * last.fold(0.0, f64::max) + 0.5
    }
}
