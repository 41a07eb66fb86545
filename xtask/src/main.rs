//! The project's chores: `cargo xtask demo`, `ci`, `doctor`, `bench`, `table`, `image`, `size`, `flash`, `tek`, `download`,
//! `emu`, `host-tools`. Each is one file here and does its own set-up; what takes long is done by the programs that they start.

#![forbid(unsafe_code)]

mod bench;
mod ci;
mod demo;
mod doctor;
mod download;
mod emu;
mod files;
mod flash;
mod fuzz;
mod hall_oracle;
mod host_tools;
mod image;
mod instructions;
mod outcome;
mod packages;
mod program;
mod python;
mod setup;
mod size;
mod table;
mod tek;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use outcome::{Failure, Outcome};

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
    /// What is installed, what is missing, what for, and how to get it
    Doctor {
        /// Print the JSON object, and nothing else, to standard output
        #[arg(long)]
        json: bool,
    },
    /// Speed of the simulator and cost of a control tick, written to bench.json
    Bench {
        /// Print the JSON object, and nothing else, to standard output
        #[arg(long)]
        json: bool,
    },
    /// The properties, commands and faults as a page: docs/properties.md
    Table {
        /// Write nothing; fail if the page is not what the tables say
        #[arg(long)]
        check: bool,
    },
    /// What is flashed: monitor and application, sealed, in all their forms
    Image(image::ImageArgs),
    /// Images of applications as `.tek` files, the form in which they are downloaded
    #[command(subcommand)]
    Tek(tek::Chore),
    /// Monitor and application onto a board, through a debug probe
    Flash(flash::FlashArgs),
    /// Flash, RAM and stack of the two programs on a board, and what must not be linked into them
    Size(size::SizeArgs),
    /// A .tek file to a board, over a CAN adapter
    Download(download::DownloadArgs),
    /// The image on emulated boards: a scenario over CAN only, from erased flash on
    Emu(emu::EmuArgs),
    /// The simulated bus and hand as host tools meet them, in real time: a download, python-can, and hosts by pyserial (installed into target/)
    HostTools,
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().chore {
        Chore::Demo => demo::demo().map_err(Failure::from),
        Chore::Ci => ci::ci().map_err(Failure::from),
        Chore::Doctor { json } => doctor::doctor(json),
        Chore::Bench { json } => bench::bench(json).map_err(Failure::from),
        Chore::Table { check } => table::table(check).map_err(Failure::from),
        Chore::Image(args) => image::image(&args),
        Chore::Flash(args) => flash::flash(&args),
        Chore::Tek(chore) => tek::tek(&chore),
        Chore::Size(args) => size::size(&args),
        Chore::Download(args) => download::download(&args),
        Chore::Emu(args) => emu::emu(&args),
        Chore::HostTools => host_tools::check().map_err(Failure::from),
    };
    let (message, code) = match outcome {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Judged(message)) => (message, 1),
        Err(Failure::Unusable(message)) => (message, 2),
    };
    eprintln!("error: {message}");
    ExitCode::from(code)
}
