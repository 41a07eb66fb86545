//! `hil-sim export`: the result of `tune` as a file that `apply` takes.

use std::error::Error;
use std::path::PathBuf;

use super::output::{is_same_file, print};
use hil_tuning::tuned::Tuned;
use programs::files;
use traces::input::BadInput;

#[derive(clap::Args)]
pub struct ExportArgs {
    /// The folder of `hil-sim tune --out`.
    dir: PathBuf,
    /// The file for `apply`, such as tuned.json.
    #[arg(long, value_name = "FILE")]
    to: PathBuf,
}

/// # Errors
/// No result in the folder, one that did not pass its validation, or a file that cannot be written.
pub fn export(args: &ExportArgs) -> Result<(), Box<dyn Error>> {
    let source = args.dir.join("tuned.json");
    let text = files::read_text(&source).map_err(|error| {
        BadInput::new(source.display().to_string(), "cannot be read")
            .found(error.to_string())
            .expected("the folder of `hil-sim tune --out`")
            .next("tune first: hil-sim tune --motor link --objective all --out DIR")
    })?;
    let tuned = Tuned::of_result(&source.display().to_string(), &text)?;
    let unwritten = |problem: &str, found: String, next: &str| {
        BadInput::new(format!("--to {}", args.to.display()), problem)
            .found(found)
            .expected("a file of its own in an existing folder")
            .next(next)
    };
    if is_same_file(&source, &args.to) {
        let found = format!("the same file as {}", source.display());
        return Err(Box::new(unwritten(
            "the export would overwrite the result",
            found,
            "choose another path",
        )));
    }
    files::replace(&args.to, tuned.text().as_bytes()).map_err(|error| {
        unwritten("cannot be written", error.to_string(), "choose another path or free space")
    })?;
    let lines: Vec<String> = tuned
        .motors
        .iter()
        .map(|motor| {
            let values: Vec<String> =
                motor.properties.iter().map(|(name, value)| format!("{name}={value}")).collect();
            format!(
                "{}: {}; no limit broken on {} unseen plants\n",
                motor.motor,
                values.join(" "),
                motor.validation.plants
            )
        })
        .collect();
    print(&format!("{}{}\n", lines.concat(), args.to.display()))?;
    Ok(())
}
