//! How far each board may go: its earliest input time (EIT), kept up to date at a cost that goes with what has changed.
//!
//! Each line's part in its receiver's `EIT` is kept, and each board knows which line it owes its own to. If that line's
//! part comes later than before, the board restarts from infinity, and so does whoever relied on it; from there all
//! go down again to what the lines say. What has not changed is not looked at.

use torno_protocol::time::Instant;
use torno_protocol::uart::Ear;

use super::sending::Sending;
use super::{Engine, Life, LineId, NodeId};

/// A line's part in its receiver's `EIT`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// The earliest instant at which an edge that has not been settled can matter to the receiver.
    effect: Instant,
    /// It would be later if the sender's `EIT` were.
    relies: bool,
}

impl Reach {
    pub(super) const NONE: Self = Self { effect: Instant::NEVER, relies: false };

    #[cfg(test)]
    pub(super) const fn effect(self) -> Instant {
        self.effect
    }
}

/// Lines and boards that [`Engine::bound`] still has to look at. Kept for its memory.
#[derive(Debug, Default)]
pub(super) struct Agenda {
    lines: Vec<LineId>,
    restarted: Vec<NodeId>,
    lowered: Vec<NodeId>,
    sending: Vec<Sending>,
}

impl Agenda {
    /// A line is not what it was.
    pub(super) fn look_at(&mut self, line: LineId) {
        self.lines.push(line);
    }
}

impl Engine {
    /// Brings every board's `EIT` up to date with what has changed since the last call.
    pub(super) fn bound(&mut self) {
        let mut agenda = core::mem::take(&mut self.agenda);
        let mut changed = core::mem::take(&mut self.changed);
        agenda.lines.extend(self.disturbed.iter());
        for id in changed.iter() {
            let node = &mut self.nodes[id];
            agenda.sending.clone_from(&node.sending);
            node.note_sending();
            let sends = node.sends_to.iter().zip(node.sending.iter().zip(&agenda.sending));
            agenda.lines.extend(sends.filter(|(_, (now, before))| now != before).filter_map(|(line, _)| *line));
            if core::mem::take(&mut node.ears_changed) {
                agenda.lines.extend(node.hears.iter().map(|(_, line)| *line));
            }
        }
        self.start_anew(&mut agenda);
        self.lower(&mut agenda);
        agenda.restarted.drain(..).chain(agenda.lowered.drain(..)).for_each(|id| _ = changed.insert(id));
        changed.iter().for_each(|id| self.reconsider(id));
        changed.clear();
        agenda.lines.clear();
        (self.changed, self.agenda) = (changed, agenda);
        #[cfg(test)]
        self.check();
    }

    /// Looks at the lines that have changed. Boards whose `EIT` may come later than before restart from infinity.
    fn start_anew(&mut self, agenda: &mut Agenda) {
        let mut next = 0;
        while let Some(line) = agenda.lines.get(next).copied() {
            next += 1;
            let reach = self.reach(line);
            let before = core::mem::replace(&mut self.reaches[line], reach);
            let to = self.lines[line].to.node;
            if reach.effect > before.effect && self.nodes[to].owes_eit_to == Some(line) {
                let node = &mut self.nodes[to];
                (node.eit, node.owes_eit_to) = (Instant::NEVER, None);
                agenda.restarted.push(to);
                agenda.lines.extend(node.sends_to.iter().flatten().filter(|line| self.reaches[**line].relies));
                agenda.lines.extend(self.disturbed.iter().filter(|line| self.lines[*line].touches_others()));
            }
        }
    }

    /// Lets every `EIT` go down to what the lines say.
    fn lower(&mut self, agenda: &mut Agenda) {
        for id in &agenda.restarted {
            let node = &mut self.nodes[*id];
            let reaches = node.hears.iter().map(|(_, line)| (self.reaches[*line].effect, *line));
            if let Some((effect, line)) = reaches.min().filter(|(effect, _)| !effect.is_never()) {
                (node.eit, node.owes_eit_to) = (effect, Some(line));
                agenda.lowered.push(*id);
            }
        }
        for line in &agenda.lines {
            self.lower_by(*line, &mut agenda.lowered);
        }
        let mut next = 0;
        while let Some(id) = agenda.lowered.get(next).copied() {
            next += 1;
            for port in 0..self.nodes[id].sends_to.len() {
                let node = &self.nodes[id];
                if let Some(line) = node.sends_to[port]
                    && (node.eit < node.sending[port].told || self.reaches[line].relies)
                {
                    self.lower_by_new(line, &mut agenda.lowered);
                }
            }
            let mut next = 0;
            while let Some(line) = self.disturbed.first_from(next) {
                next = line + 1;
                if self.lines[line].touches_others() {
                    self.lower_by_new(line, &mut agenda.lowered);
                }
            }
        }
    }

    fn lower_by_new(&mut self, line: LineId, lowered: &mut Vec<NodeId>) {
        self.reaches[line] = self.reach(line);
        self.lower_by(line, lowered);
    }

    fn lower_by(&mut self, line: LineId, lowered: &mut Vec<NodeId>) {
        let to = self.lines[line].to.node;
        let (node, effect) = (&mut self.nodes[to], self.reaches[line].effect);
        if effect < node.eit {
            (node.eit, node.owes_eit_to) = (effect, Some(line));
            lowered.push(to);
        }
    }

    pub(super) fn reach(&mut self, line: LineId) -> Reach {
        #[cfg(test)]
        {
            self.computed += 1;
        }
        let wire = &self.lines[line];
        let (edge, relies) = if wire.is_disturbed() {
            let next_change = wire.next_change(|other, at| self.lines[other].driven(at));
            (self.sure_until(line).min(next_change), true)
        } else {
            let from = &self.nodes[wire.from.node];
            let sending = from.sending[usize::from(wire.from.port)];
            let edge = sending.earliest_edge(from.eit);
            (edge, edge < sending.earliest_edge(Instant::NEVER))
        };
        let ears = &self.nodes[wire.to.node].ears;
        let effect = ears.get(usize::from(wire.to.port)).map_or(edge, |ear: &Ear| ear.effect(edge));
        Reach { effect, relies }
    }

    /// Before this instant nothing can change what is known of a disturbed line.
    pub(super) fn sure_until(&self, line: LineId) -> Instant {
        let wire = &self.lines[line];
        let drivers = wire.contacts().chain([line]).map(|line| self.lines[line].from);
        let driven = drivers.map(|end| {
            let node = &self.nodes[end.node];
            node.sending[usize::from(end.port)].earliest_edge(node.eit)
        });
        let receiver = &self.nodes[wire.to.node];
        let noise = wire.noise_until((receiver.life == Life::Runs).then_some(receiver.commit));
        driven.min().unwrap_or(Instant::NEVER).min(noise)
    }
}
