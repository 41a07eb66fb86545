//! The project's chores: `cargo xtask demo`, `cargo xtask ci`, `cargo xtask bench`. Each is one file here and
//! does its own set-up; the work itself is done by the programs that they start.

#![forbid(unsafe_code)]

mod bench;
mod ci;
mod demo;
mod fuzz;
mod hall_oracle;
mod program;
mod setup;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// What a chore gives back: nothing, or a text for the person who called it.
type Outcome = Result<(), String>;

#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", about = "The project's chores")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// The main job: tuning runs of a simulated motor, with metrics and a report to open
    Demo,
    /// All checks and tests, as continuous integration runs them
    Ci,
    /// Speed of the simulator and cost of a control tick, written to bench.json
    Bench {
        /// Print the JSON object, and nothing else, to standard output
        #[arg(long)]
        json: bool,
    },
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().chore {
        Chore::Demo => demo::demo(),
        Chore::Ci => ci::ci(),
        Chore::Bench { json } => bench::bench(json),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}
