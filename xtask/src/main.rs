//! The project's tools: `cargo xtask demo`, `check`, `ci`, `nightly`, `doctor`, `bench`, `table`, `image`, `size`, `flash`,
//! `tek`, `download`, `apply`, `emu`, `host-tools`, `c-library`, `fuzz`, `fresh`, `miri`, `mutants`, `defects`, `soak`, `model`, `wheel`, `windows`. One file each, with its own set-up; they start other programs for
//! anything slow.

#![forbid(unsafe_code)]

mod apply;
mod bench;
mod c_library;
mod ci;
mod defects;
mod demo;
mod doctor;
mod download;
mod emu;
mod files;
mod flash;
mod fresh;
mod fuzz;
mod hall_oracle;
mod host_tools;
mod image;
mod instructions;
mod miri;
mod model;
mod mutants;
mod outcome;
mod packages;
mod program;
mod promises;
mod python;
mod ray_sweep;
mod reports;
mod served;
mod setup;
mod size;
mod soak;
mod table;
mod tek;
mod wheel;
mod windows;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use outcome::{Failure, Outcome};
use programs::output::warn;

#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", about = "Tools for building, testing and flashing")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// Demonstration: tuning runs of a simulated motor, with metrics and a report
    Demo,
    /// What Rust and a linker alone can check, in ten minutes
    Check,
    /// All checks and tests before a merge, as continuous integration runs them
    Ci,
    /// Checks that take longer: fuzzing, Miri, mutants, soak, ten times as many samples
    Nightly,
    /// List installed and missing tools, their purpose, and how to install them
    Doctor {
        /// Print the JSON object, and nothing else, to standard output
        #[arg(long)]
        json: bool,
    },
    /// Measure simulator speed and instructions of a control tick; writes bench.json
    Bench {
        /// Print the JSON object, and nothing else, to standard output
        #[arg(long)]
        json: bool,
    },
    /// Generate docs/properties.md: properties, commands and faults
    Table {
        /// Write nothing; fail if the page is out of date
        #[arg(long)]
        check: bool,
    },
    /// Generate the URDF and the MJCF of the hand: kinematics/model
    Model {
        /// Write nothing; fail if a file is out of date
        #[arg(long)]
        check: bool,
        /// The same, and compare fingertips with yourdfpy and MuJoCo, installed below target/
        #[arg(long)]
        compare: bool,
    },
    /// Build monitor and application in all forms, sealed
    Image(image::ImageArgs),
    /// Make, check and read `.tek` files, the download format of applications
    #[command(subcommand)]
    Tek(tek::Chore),
    /// Write monitor and application to a board through a debug probe
    Flash(flash::FlashArgs),
    /// Report flash, RAM and stack of both programs, and symbols that must not be linked
    Size(size::SizeArgs),
    /// Download a .tek file to a board over a CAN adapter
    Download(download::DownloadArgs),
    /// Write tuned values to boards over a CAN adapter, read back and stored; --undo takes them back
    Apply(apply::ApplyArgs),
    /// Run the image on emulated boards: a scenario over CAN, from erased flash
    Emu(emu::EmuArgs),
    /// Test the simulated bus and hand with real host tools in real time: python-can and pyserial, installed
    /// below target/
    HostTools,
    /// Generate the C library's header, and lay out library, headers, pkg-config and CMake files in target/wraptor-c
    CLibrary {
        /// Check that the header is current, and build and run the examples against a simulated hand (cmake is installed below target/)
        #[arg(long)]
        check: bool,
    },
    /// Spread a sweep with Ray and compare its bytes (installs ray below target/)
    RaySweep,
    /// Open the reports of hil-sim in a headless Chromium, which is installed if it can be (as ci does).
    Reports,
    /// Build the Python wheel into target/wheels and print the command that installs it (installs maturin below target/)
    Wheel(wheel::WheelArgs),
    /// Build host programs for Windows and run them under Wine
    Windows,
    /// Run every fuzz target for 30 s from its committed inputs
    Fuzz(fuzz::FuzzArgs),
    /// Play seeds that no run has played: torture chamber, property tests, fuzz targets; before an issue is resolved
    Fresh(fresh::FreshArgs),
    /// Run unit tests under Miri, which finds undefined behavior, if it is installed
    Miri,
    /// Change the code in one place at a time, and list the changes that no unit test notices
    Mutants(mutants::MutantsArgs),
    /// Plant one defect at a time, and check that the torture chamber finds it
    Defects(defects::DefectsArgs),
    /// Let clients come and go at a simulated hand, whose memory, threads and files must not grow
    Soak {
        /// Simulated hours
        #[arg(long, default_value_t = 10.0)]
        hours: f64,
    },
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().chore {
        Chore::Demo => demo::demo().map_err(Failure::from),
        Chore::Check => ci::check().map_err(Failure::from),
        Chore::Ci => ci::ci().map_err(Failure::from),
        Chore::Nightly => ci::nightly().map_err(Failure::from),
        Chore::Doctor { json } => doctor::doctor(json),
        Chore::Bench { json } => bench::bench(json).map_err(Failure::from),
        Chore::Table { check } => table::table(check).map_err(Failure::from),
        Chore::Model { compare: true, .. } => model::check().map_err(Failure::from),
        Chore::Model { check, .. } => model::model(check).map_err(Failure::from),
        Chore::Image(args) => image::image(&args),
        Chore::Flash(args) => flash::flash(&args),
        Chore::Tek(chore) => tek::tek(&chore),
        Chore::Size(args) => size::size(&args),
        Chore::Download(args) => download::download(&args),
        Chore::Apply(args) => apply::apply(&args),
        Chore::Emu(args) => emu::emu(&args),
        Chore::HostTools => host_tools::check().map_err(Failure::from),
        Chore::CLibrary { check: true } => c_library::check().map_err(Failure::from),
        Chore::CLibrary { check: false } => c_library::c_library().map_err(Failure::from),
        Chore::RaySweep => ray_sweep::check().map_err(Failure::from),
        Chore::Reports => reports::check().map_err(Failure::from),
        Chore::Wheel(args) => wheel::wheel(&args),
        Chore::Windows => windows::check().map_err(Failure::from),
        Chore::Fuzz(args) => fuzz::fuzz(&args).map_err(Failure::from),
        Chore::Fresh(args) => fresh::fresh(&args).map_err(Failure::from),
        Chore::Miri => miri::check().map_err(Failure::from),
        Chore::Mutants(args) => mutants::mutants(&args),
        Chore::Defects(args) => defects::defects(&args),
        Chore::Soak { hours } => soak::soak(hours).map_err(Failure::from),
    };
    let (message, code) = match outcome {
        Ok(()) => return ExitCode::SUCCESS,
        Err(Failure::Judged(message)) => (message, 1),
        Err(Failure::Unusable(message)) => (message, 2),
    };
    warn(&format!("error: {message}"));
    ExitCode::from(code)
}
