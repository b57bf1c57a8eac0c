//! The live page of a rig: the assets that a browser shows, and the server that gives them to nobody but the user who
//! runs the rig.
//!
//! The server knows requests and texts, and no rig: what is asked goes to [`Behind`], and what a browser is to be told
//! comes from there. It listens on loopback unless another address is asked for. Every path begins with a random token,
//! and requests that another site lets a browser make are refused: see `guard.rs`.

mod assets;
mod body;
mod guard;
mod server;
mod token;

pub use server::{Answer, Behind, PageError, Server};
