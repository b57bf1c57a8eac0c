//! The tests of the whole: whole programs with real processes and real ports. One program, so that the harness is
//! linked once.
//!
//! All of them run at once and share one process: none may change the environment, the current directory, the umask or
//! a panic hook, and each has folders and links of its own.

#![allow(clippy::unwrap_used, reason = "in a test, a panic is an answer")]

mod common;

mod anything;
mod bounds;
mod byhand;
mod cli;
mod compare;
mod ctl;
mod ears;
mod engraver;
mod errata;
mod failures;
mod faults;
mod foreign;
mod gcode;
mod grbl;
mod grbl_eeprom;
mod grbl_port;
mod grbl_run;
mod hostile;
mod identify;
mod imports;
mod interrupt;
mod log;
mod machine;
mod own_slave;
mod page;
mod part;
mod pc_port;
mod pins;
mod plan;
mod preview;
mod processes;
mod promise;
mod recordings;
mod report;
mod run;
mod saving;
mod scenarios;
mod send;
mod servo;
mod servo_port;
mod stats;
mod sweep;
mod tidy;
mod trace;
mod turning;
mod verdicts;
mod watched;
mod ways;
