//! `report.html` of a sweep's folder, from its table.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

use super::sweep_folder::{CSV, Header, failed};
use hil_experiment::motor_file::MotorFile;
use hil_tuning::sweep::{Report, Sweep, fields};
use programs::files;
use traces::input::BadInput;

/// The page's name.
pub const PAGE: &str = "report.html";

/// Writes the page of a whole sweep, whose table is in the folder.
pub fn write(folder: &Path, header: &Header) -> Result<(), BadInput> {
    let (csv, page) = (folder.join(CSV), folder.join(PAGE));
    let motor = header.motor.as_ref().map(|motor| MotorFile::parse(&motor.name, &motor.text)).transpose()?;
    let sweep = Sweep::parse("sweep.toml", &header.file, motor, &mut |name| {
        let own = header.scenarios.iter().find(|scenario| scenario.name == name);
        let text = own.map(|scenario| (scenario.name.clone(), scenario.text.clone()));
        text.ok_or_else(|| failed(&csv, &io::Error::other(format!("sweep.json lacks the scenario {name}"))))
    })?;
    let lines = BufReader::new(File::open(&csv).map_err(|e| failed(&csv, &e))?).lines();
    let mut report = Report::new(&header.columns, header.runs);
    for line in lines.skip(1) {
        let line = line.map_err(|e| failed(&csv, &e))?;
        let cells = fields(&line);
        report.row(&cells.ok_or_else(|| failed(&csv, &io::Error::other("the file was changed meanwhile")))?);
    }
    files::replace(&page, report.html(&sweep, &header.commit).as_bytes()).map_err(|e| failed(&page, &e))
}
