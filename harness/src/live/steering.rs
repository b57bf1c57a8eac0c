//! A live rig at its control socket: what is done only where programs outside have their ports, and when.

use std::sync::{Arc, PoisonError};
use std::time::Duration;

use torno_protocol::time::Instant;

use super::Live;
use super::player::Player;
use crate::control::{Answer, Call, Control, Done, Request};
use crate::fault::Planned;
use crate::pace::Pace;
use crate::preview::Preview;
use crate::report::FaultSummary;
use crate::saving::{Product, Saving};
use crate::session::SessionError;
use crate::steering::{Before, Scene, Steering, tell_done};
use torno_bus::Names;
use torno_trace::Header;

impl Live {
    /// Does what is asked.
    pub(super) async fn carry_out(&mut self, call: Call) -> Result<(), SessionError> {
        let now = self.now();
        match Before::of(&call.request) {
            Before::Anything => {}
            Before::CaughtUp => loop {
                let happened = self.session.catch_up(now).await?;
                self.deliver(&happened)?;
                if !happened.more {
                    break;
                }
            },
            Before::Settled => self.settle(now).await?,
        }
        match call.request {
            Request::Play { program } => tell_done(call.answer, self.play(&program, now)?, now),
            Request::Stop => tell_done(call.answer, self.stop(now)?, now),
            Request::Preview { program } => self.preview(program, call.answer),
            Request::Save { what } => self.save(what, call.answer, now).await?,
            _ => {
                let Some(steering) = &mut self.steering else { return Ok(()) };
                let program = self.program.as_ref().map(Player::state);
                let (session, brake, path) = (&mut self.session, &mut self.brake, self.path.as_mut());
                steering.carry_out(call, Scene { session, brake, path, program, now });
            }
        }
        Ok(())
    }

    /// Looks at a program that is not played yet. The rig goes on meanwhile.
    fn preview(&self, program: String, answer: Answer) {
        let (file, rehearsal) = (Arc::clone(&self.file), Arc::clone(&self.rehearsal));
        std::thread::spawn(move || {
            let _one = rehearsal.lock().unwrap_or_else(PoisonError::into_inner);
            answer.give(Ok(Preview::of(&file, &program)));
        });
    }

    /// Makes something of what has happened so far. The rig goes on meanwhile.
    async fn save(&mut self, product: Product, answer: Answer, now: Instant) -> Result<(), SessionError> {
        if let Err(why) = product.check(&self.file) {
            answer.give(Err::<Done, _>(why));
            return Ok(());
        }
        let rig = self.file.name.clone();
        let until = self.session.earliest_end(now);
        self.settle(until).await?;
        let so_far = match self.session.so_far(until) {
            Ok(Some(so_far)) => so_far,
            Ok(None) => {
                answer.give(Err::<Done, _>("nothing is kept: expected 'torno up' without '--keep 0'".to_owned()));
                return Ok(());
            }
            Err(error) => {
                answer.give(Err::<Done, _>(format!("what is kept cannot be read: {error}")));
                return Ok(());
            }
        };
        let saving = Saving { product, faults: FaultSummary::of(self.session.begun()), so_far };
        std::thread::spawn(move || match saving.make(&rig) {
            Ok(saved) => answer.hand(saving.so_far.until.as_nanos(), saved),
            Err(why) => answer.give(Err::<Done, _>(why)),
        });
        Ok(())
    }

    /// Takes faults that begin by themselves, for a rig that does not run yet.
    pub fn plan(&mut self, planned: &[Planned]) {
        self.session.plan(planned);
    }

    /// Lets the rig be steered from outside. For a rig that does not run yet.
    pub fn steer(&mut self, control: Control, header: Header, names: Names) {
        self.steering = Some(Steering::new(control, header, names));
    }

    /// Does all that has been asked meanwhile. What is asked is of the instant at which it is asked: at a pace, time
    /// must be `up_to_date`, that is where the wall clock is, unless that takes longer than somebody can be kept
    /// waiting. Says whether anything was done.
    pub(super) async fn carry_out_due(&mut self, up_to_date: bool) -> Result<bool, SessionError> {
        let held_back = self.brake.paused().is_none() && self.brake.pace() != Pace::Max;
        if held_back && !up_to_date && !self.asked.is_over(Duration::ZERO) {
            return Ok(false);
        }
        let mut obeyed = false;
        while let Some(call) = self.steering.as_mut().and_then(Steering::next_call) {
            self.carry_out(call).await?;
            obeyed = true;
        }
        Ok(obeyed)
    }
}
