//! The planner: takes motions, gives frames.

use std::collections::VecDeque;

use torno_gcode::{Feed as Asked, Kind, Motion, Place as Point, Plane};
use torno_part::Place;
use torno_protocol::lathe::TransverseSubFrame;

use crate::feed;
use crate::finding::{Finding, Findings, Once};
use crate::merge::{Merge, Move};
use crate::place::{Side, Slide};
use crate::rapid;
use crate::scale::Scale;
use crate::spindle::{Spindle, Turning};
use crate::stairs::{Round, Section, Sections};
use crate::stock::Stock;

pub use crate::merge::Planned;

/// Less is no way, in mm.
const NOISE: f64 = 1e-9;
/// The slide keeps so many slots away from its ends of travel: half a slot, and what a choice of slots is off.
const CLEAR_SLOTS: f64 = 1.5;
/// The carriage keeps so many counts away from its own: what it may overshoot.
const CLEAR_COUNTS: i64 = 45;

/// So far from the part a shortcut keeps: the slots that two places are rounded by, and half of one.
const CLEARANCE_SLOTS: f64 = 1.5;
/// No more places are held.
const HELD_MAX: usize = 1_000;

/// How a program is planned.
#[derive(Clone, Debug)]
pub struct Settings {
    /// What a frame's numbers are worth.
    pub scale: Scale,
    /// What the program calls the place at which the tool stands at the start, in mm.
    pub start: Place,
    /// On which side of the ideal path the tool goes.
    pub side: Side,
    /// Whether the tool turns bores: then the part lies at greater radii than the tool.
    pub bore: bool,
    /// What the tool meets, if that is known.
    pub stock: Option<Stock>,
    /// Whether rapids between two cuts leave the part no further than they must.
    pub optimise: bool,
    /// A plan has no more frames: a program may be without end.
    pub frames_max: u64,
}

impl Settings {
    /// So many frames take more than a week.
    pub const FRAMES_MAX: u64 = 1_000_000;
}

/// What there is to say of a plan.
#[derive(Clone, Debug)]
pub struct Report {
    /// Its frames.
    pub frames: u64,
    /// How far the tool is from the ideal path of the cuts at most, in mm, on each axis.
    pub worst: Place,
    /// Where the tool stands at the end, in the program's mm.
    pub end: Place,
    /// What the program's author has to know.
    pub findings: Vec<Finding>,
    /// Whether the program is refused: then the frames are good for nothing.
    pub refused: bool,
    /// The bar, as the ideal path has cut it.
    pub stock: Option<Stock>,
}

/// Where the tool stands, as its boards count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Standing {
    /// Counts of the axis along the bar, from the start.
    pub count: i64,
    /// The slot that the slide across it was sent to last, from the start.
    pub slot: i64,
    /// The sense in which it came there: 1, −1, or 0 before the first move.
    pub sense: i64,
}

/// A cut that is under way.
#[derive(Clone, Debug)]
struct Cut {
    line: usize,
    /// As the program has it, in mm a minute.
    feed: f64,
    units: u8,
    turning: Turning,
    sections: Sections,
    section: Option<Section>,
    /// It has been refused: once is enough.
    refused: bool,
}

/// Plans a program, motion by motion and frame by frame.
#[derive(Clone, Debug)]
pub struct Planner {
    settings: Settings,
    findings: Findings,
    spindle: Spindle,
    slide: Slide,
    /// Of the axis along the bar, from the start.
    count: i64,
    /// Where the program is.
    at: Place,
    /// The axes that the lathe does not have.
    others: [f64; 2],
    /// The line of the last motion.
    line: usize,
    tool: Option<u32>,
    /// Rapids that wait for what follows them: from where, and over which places, each with its line.
    held: Option<(Place, Vec<(usize, Place)>)>,
    /// What is left of the cut's motion is a rapid to this place.
    rest: Option<(usize, Place)>,
    cut: Option<Cut>,
    moves: VecDeque<Move>,
    merge: Merge,
    worst: Place,
    frames: u64,
    /// Steps of the work: frames, and sections that make none.
    steps: u64,
    ended: bool,
    flushed: bool,
}

impl Planner {
    /// At the start of a program.
    pub fn new(settings: Settings) -> Self {
        Self {
            findings: Findings::default(),
            spindle: Spindle::new(),
            slide: Slide::new(&settings.scale.infeed, settings.start.x),
            count: 0,
            at: settings.start,
            others: [0.0; 2],
            line: 1,
            tool: None,
            held: None,
            rest: None,
            cut: None,
            moves: VecDeque::new(),
            merge: Merge::default(),
            worst: Place::default(),
            frames: 0,
            steps: 0,
            ended: false,
            flushed: false,
            settings,
        }
    }

    /// Takes the next motion. The frames of the one before have been taken: [`Planner::poll`] gave none.
    pub fn take(&mut self, motion: &Motion) {
        if self.is_done() {
            return;
        }
        let line = motion.line;
        self.line = line;
        if !matches!(motion.kind, Kind::Rapid { .. } | Kind::Plane(_) | Kind::Coolant { .. }) {
            self.release(matches!(motion.kind, Kind::Feed { .. } | Kind::Arc { .. }));
        }
        match motion.kind {
            Kind::Rapid { to } => {
                if let Some(to) = self.in_plane(line, to) {
                    self.rapid(line, to);
                }
            }
            Kind::Feed { to, feed } => {
                if let Some(end) = self.in_plane(line, to) {
                    let to = self.clear_from(end).unwrap_or(end);
                    self.rest = (to != end).then_some((line, end));
                    self.cut(line, to, feed, Sections::Straight(Section::straight(self.at, to)));
                }
            }
            Kind::Arc { to, plane, centre, turn, turns, feed } => {
                let Some(to) = self.in_plane(line, to) else { return };
                if plane != Plane::Zx {
                    self.findings.refuse(line, b'g', "the lathe's arcs lie in the plane of X and Z (G18)");
                    self.at = to;
                    return;
                }
                let centre = Place { z: centre[0], x: centre[1] };
                self.cut(line, to, feed, Sections::Round(Round::new(self.at, to, centre, turn, turns)));
            }
            Kind::Spindle { sense, speed } => {
                let stops = self.spindle.set(line, sense, speed, &mut self.findings);
                if stops {
                    self.stop(line);
                }
            }
            Kind::Dwell { .. } => {
                let message = || "a dwell has no effect: a frame cannot wait".to_owned();
                self.findings.warn(Once::Dwell, line, b'g', message);
            }
            Kind::Stop { .. } => {
                let message = || "a stop has no effect: no one is waited for".to_owned();
                self.findings.warn(Once::Stop, line, b'm', message);
            }
            Kind::Tool(tool) => {
                if *self.tool.get_or_insert(tool) != tool {
                    let message = || format!("tool {tool} cuts as the one before: the lathe has one");
                    self.findings.warn(Once::Tool, line, b't', message);
                }
            }
            Kind::Plane(_) | Kind::Coolant { .. } => {}
            Kind::End => self.end(line),
        }
    }

    /// At a place where the tool stands already.
    pub fn standing(settings: Settings, at: Standing) -> Self {
        let mut planner = Self::new(settings);
        planner.count = at.count;
        planner.slide = planner.slide.standing(at.slot, at.sense);
        let Settings { scale, start, .. } = &planner.settings;
        planner.at = Place { z: start.z + scale.feed.mm_per_count * at.count as f64, x: planner.slide.x() };
        planner
    }

    /// Where the program is, in mm.
    pub const fn place(&self) -> Place {
        self.at
    }

    /// Nothing follows for now: what could be joined with what follows is given away. [`Planner::poll`] gave none.
    pub const fn flush(&mut self) {
        self.merge.end();
    }

    /// Nothing follows.
    pub fn finish(&mut self) {
        self.end(self.line);
    }

    /// Whether what follows means nothing: the program has ended, or too much is wrong with it.
    pub const fn is_done(&self) -> bool {
        self.ended || self.findings.are_enough()
    }

    /// The next frame; None if a motion is wanted, or nothing follows.
    pub fn poll(&mut self) -> Option<Planned> {
        loop {
            if let Some(planned) = self.merge.poll() {
                self.frames += 1;
                return Some(planned);
            }
            if let Some(next) = self.moves.pop_front() {
                self.merge.push(next);
            } else if self.cut.is_some() {
                self.go_on();
            } else if let Some((line, to)) = self.rest.take() {
                self.rapid(line, to);
            } else if self.ended && !self.flushed {
                self.merge.end();
                self.flushed = true;
            } else {
                return None;
            }
        }
    }

    /// What there is to say of the plan, after its end.
    pub fn report(self) -> Report {
        let Self { settings, findings, slide, count, worst, frames, .. } = self;
        Report {
            frames,
            worst,
            end: Place { z: settings.start.z + settings.scale.feed.mm_per_count * count as f64, x: slide.x() },
            refused: findings.refused(),
            findings: findings.list(),
            stock: settings.stock,
        }
    }

    fn end(&mut self, line: usize) {
        self.release(false);
        if !self.ended {
            self.stop(line);
        }
        self.ended = true;
    }

    /// The spindle stops.
    fn stop(&mut self, line: usize) {
        if self.spindle.units != 0 {
            self.spindle.units = 0;
            self.turn(line);
        }
    }

    /// A frame for the spindle alone.
    fn turn(&mut self, line: usize) {
        self.push(Move { line, spindle: self.spindle.units, feed: (0, 0), infeed: 0 });
    }

    fn push(&mut self, next: Move) {
        self.moves.push_back(next);
        self.step(next.line);
    }

    /// Counts a step of the work, which has an end.
    fn step(&mut self, line: usize) {
        self.steps += 1;
        if self.steps == self.settings.frames_max + 1 {
            let most = self.settings.frames_max;
            self.findings.refuse(line, 0, format!("the plan has more than {most} frames"));
            self.cut = None;
            self.ended = true;
        }
    }

    /// The end of a motion, if the lathe has all axes that move, and they can go there.
    fn in_plane(&mut self, line: usize, to: Point) -> Option<Place> {
        for (index, (name, value)) in [(b'y', to.y), (b'a', to.a)].into_iter().enumerate() {
            if (value - self.others[index]).abs() > NOISE {
                let letter = char::from(name).to_ascii_uppercase();
                self.findings.refuse(line, name, format!("the lathe has no axis {letter}"));
                self.others[index] = value;
            }
        }
        let to = Place { z: to.z, x: to.x };
        let within = self.is_within(line, to);
        if !within {
            self.at = to;
        }
        within.then_some(to)
    }

    /// Whether a place lies between the ends of travel; tells if it does not.
    fn is_within(&mut self, line: usize, to: Place) -> bool {
        let Settings { scale: Scale { feed, infeed }, start, .. } = &self.settings;
        let z = (feed.reach - CLEAR_COUNTS).max(0) as f64 * feed.mm_per_count.abs();
        let x = (infeed.reach as f64 - CLEAR_SLOTS).max(0.0) * infeed.mm_per_slot.abs();
        for (word, name, to, from, reach) in [(b'z', "Z", to.z, start.z, z), (b'x', "X", to.x, start.x, x)] {
            if (to - from).abs() > reach {
                let (least, most) = (from - reach, from + reach);
                let radius = if word == b'x' { ", as a radius" } else { "" };
                let message =
                    format!("{name} is to go to {to:.3} mm{radius}: its travel is {least:.2} to {most:.2} mm");
                self.findings.refuse(line, word, message);
                return false;
            }
        }
        true
    }

    /// A place of the program on the bar.
    fn shift(&self) -> Place {
        let start = self.settings.start;
        let bar = self.settings.stock.as_ref().map_or(start, |stock| stock.start);
        Place { z: bar.z - start.z, x: bar.x - start.x }
    }

    fn rapid(&mut self, line: usize, to: Place) {
        let (shift, away) = (self.shift(), !self.settings.bore);
        let stock = self.settings.stock.as_ref().map(|stock| (stock, shift));
        let rapid::RapidPath { over, meets } = rapid::way(self.at, to, away, stock);
        if let Some(Place { z, x }) = meets {
            let (z, x) = (z - shift.z, x - shift.x);
            let word = if (to.x - self.at.x).abs() > NOISE { b'x' } else { b'z' };
            self.findings.refuse_what_follows(
                line,
                word,
                format!("the rapid cuts the part at Z {z:.3}, X {x:.3} (radius)"),
            );
        }
        let from = core::mem::replace(&mut self.at, to);
        if self.settings.optimise {
            let (_, held) = self.held.get_or_insert_with(|| (from, Vec::new()));
            held.extend(over.map(|to| (line, to)));
            if held.len() > HELD_MAX {
                self.release(false);
            }
        } else {
            self.go_over(from, over.map(|to| (line, to)));
        }
    }

    /// Goes fast over places, one axis to each.
    fn go_over(&mut self, mut from: Place, over: impl IntoIterator<Item = (usize, Place)>) {
        for (line, to) in over {
            if (to.x - from.x).abs() > NOISE {
                self.slide_to(line, to.x);
            }
            self.feed_to(line, to.z, TransverseSubFrame::SPEED_MAX);
            from = to;
        }
    }

    /// Goes the rapids that have waited; a shorter way, if a cut follows and there is one.
    fn release(&mut self, cut_follows: bool) {
        let Some((from, over)) = self.held.take() else { return };
        let (shift, away) = (self.shift(), !self.settings.bore);
        let clearance = CLEARANCE_SLOTS * self.settings.scale.infeed.mm_per_slot.abs();
        let radii = over.iter().map(|(_, place)| place.x);
        let highest = if away { radii.fold(from.x, f64::max) } else { radii.fold(from.x, f64::min) };
        let shortcut = self.settings.stock.as_ref().filter(|_| cut_follows).and_then(|stock| {
            let (line, to) = *over.last()?;
            let places = rapid::shortcut(from, to, highest, clearance, away, (stock, shift))?;
            Some(places.map(|to| (line, to)))
        });
        match shortcut {
            Some(places) => self.go_over(from, places),
            None => self.go_over(from, over),
        }
    }

    /// From where on a cut to a place is a retract: it goes straight away from the part, and cuts nothing more.
    fn clear_from(&self, to: Place) -> Option<Place> {
        let stock = self.settings.stock.as_ref().filter(|_| self.settings.optimise)?;
        let leaves = if self.settings.bore { to.x < self.at.x } else { to.x > self.at.x };
        if !leaves || (to.z - self.at.z).abs() > NOISE {
            return None;
        }
        let Place { z, x } = self.shift();
        let on_bar = |place: Place| Place { z: place.z + z, x: place.x + x };
        let clear = stock.clear_from(on_bar(self.at), on_bar(to));
        Some(Place { z: to.z, x: clear.x - x })
    }

    /// Begins a cut.
    fn cut(&mut self, line: usize, to: Place, feed: Asked, sections: Sections) {
        let Settings { scale, .. } = &self.settings;
        // Nowhere on the cut may the surface be too fast.
        let radius = self.at.x.abs().max(to.x.abs());
        let before = self.spindle.units;
        let turning = self.spindle.for_cut(radius, &mut self.findings);
        let feed = match feed {
            Asked::PerMinute(feed) => feed,
            Asked::PerRevolution(feed) => feed * self.spindle.rpm(),
        };
        let feeds = matches!(sections, Sections::Round(_)) || (to.z - self.at.z).abs() > NOISE;
        let units = match turning {
            // That is refused, or nothing is cut.
            Turning::Not if feed == 0.0 => Some(1),
            _ if feeds => feed::units(&scale.feed, feed, line, &mut self.findings),
            _ => Some(1),
        };
        let infeed = scale.infeed.mm_per_s * 60.0;
        if matches!(sections, Sections::Round(_)) || (to.x - self.at.x).abs() > NOISE {
            self.findings.warn(Once::InfeedSpeed, line, b'f', || {
                format!("across the bar the tool goes {infeed:.2} mm a minute, whatever the feed is")
            });
        }
        if self.spindle.units != before {
            self.turn(line);
        }
        let units = units.unwrap_or(1);
        self.cut = Some(Cut { line, feed, units, turning, sections, section: None, refused: false });
    }

    /// Does the next part of a cut: a section of it begins, or a step is made, or it ends.
    fn go_on(&mut self) {
        let Some(mut cut) = self.cut.take() else { return };
        if let Some(section) = cut.section {
            let Settings { side, bore, .. } = self.settings;
            let line = cut.line;
            let step = if section.feeds() { section.next(&self.slide, side, !bore) } else { None };
            if let Some((ideal, next)) = step {
                self.note(ideal.x);
                self.cut_to(&cut, ideal.z);
                self.go(line, next);
                self.note(ideal.x);
            } else {
                if !section.feeds() && section.grows().is_some() {
                    self.slide_to(line, section.to.x);
                }
                self.cut_to(&cut, section.to.z);
                self.note(section.to.x);
                self.at = section.to;
                cut.section = None;
            }
        } else {
            let Some(section) = cut.sections.next() else { return };
            if !self.is_within(cut.line, section.to) {
                self.at = section.to;
                return;
            }
            self.begin(&mut cut, &section);
            cut.section = Some(section);
            self.step(cut.line);
        }
        if !self.ended {
            self.cut = Some(cut);
        }
    }

    /// Cuts a section out of the bar; tells if that must not be.
    fn begin(&mut self, cut: &mut Cut, section: &Section) {
        let shift = self.shift();
        let Self { settings, findings, spindle, .. } = self;
        let mut limit = f64::INFINITY;
        let mut cuts = true;
        if let Some(stock) = &mut settings.stock {
            limit = stock.limits.feed * 60.0;
            cuts = false;
            let on_bar = |place: Place| Place { z: place.z + shift.z, x: place.x + shift.x };
            let mut from = on_bar(section.from);
            for to in section.chords().map(on_bar) {
                cuts |= stock.cut(from, to).is_some();
                from = to;
            }
        }
        if !cuts {
            if let Turning::TooSlow(rpm) = cut.turning {
                spindle.tell_raised(rpm, findings);
            }
            return;
        }
        let got = if section.feeds() { f64::from(cut.units) * settings.scale.feed.unit() } else { 0.0 };
        let why = match cut.turning {
            Turning::Not => (b'g', "this cuts, and the spindle stands".to_owned()),
            Turning::TooSlow(rpm) => {
                (b's', format!("this cuts, and the spindle is to turn at {rpm:.0} rpm: it cuts at 200 and more"))
            }
            Turning::Yes if got > limit * (1.0 + NOISE) => {
                let feed = cut.feed;
                (b'f', format!("this cuts at {feed:.0} mm a minute: the part allows {limit:.0} (rapid_mm_per_s)"))
            }
            Turning::Yes => return,
        };
        if !cut.refused {
            findings.refuse_what_follows(cut.line, why.0, why.1);
        }
        cut.refused = true;
    }

    /// The tool is so far off the ideal path here.
    fn note(&mut self, ideal: f64) {
        self.worst.x = self.worst.x.max((self.slide.x() - ideal).abs());
    }

    fn slide_to(&mut self, line: usize, x: f64) {
        let Settings { side, bore, .. } = self.settings;
        self.go(line, self.slide.best(x, side, !bore));
    }

    fn go(&mut self, line: usize, next: Slide) {
        let infeed = next.slot - self.slide.slot;
        self.slide = next;
        if infeed != 0 {
            self.push(Move { line, spindle: self.spindle.units, feed: (0, 0), infeed });
        }
    }

    fn cut_to(&mut self, cut: &Cut, z: f64) {
        self.feed_to(cut.line, z, cut.units);
        let Settings { scale, start, .. } = &self.settings;
        let got = start.z + scale.feed.mm_per_count * self.count as f64;
        self.worst.z = self.worst.z.max((got - z).abs());
    }

    fn feed_to(&mut self, line: usize, z: f64, speed: u8) {
        let Settings { scale, start, .. } = &self.settings;
        let count = scale.feed.count(z - start.z);
        let counts = count - self.count;
        self.count = count;
        if counts != 0 {
            self.push(Move { line, spindle: self.spindle.units, feed: (counts, speed), infeed: 0 });
        }
    }
}

/// The frames of motions that are at hand, one by one.
#[derive(Debug)]
pub struct Plan<I> {
    motions: I,
    planner: Planner,
}

/// Plans motions.
pub fn plan<I: Iterator<Item = Motion>>(settings: Settings, motions: I) -> Plan<I> {
    Plan { motions, planner: Planner::new(settings) }
}

impl<I: Iterator<Item = Motion>> Iterator for Plan<I> {
    type Item = Planned;

    fn next(&mut self) -> Option<Planned> {
        loop {
            if let Some(planned) = self.planner.poll() {
                return Some(planned);
            }
            if self.planner.flushed {
                return None;
            }
            match self.motions.next().filter(|_| !self.planner.is_done()) {
                Some(motion) => self.planner.take(&motion),
                None => self.planner.finish(),
            }
        }
    }
}

impl<I> Plan<I> {
    /// What there is to say of the plan, after its last frame.
    pub fn report(self) -> Report {
        self.planner.report()
    }
}
