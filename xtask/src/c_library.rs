//! The C library: its header, its files as an installation has them, and C and C++ programs that use it.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::program::{
    in_parallel, installed, output, output_of_both, program, root, run, succeeds, target, typed,
};
use crate::served::Served;
use crate::table::difference;
use crate::{Outcome, files, host_tools, python};

const CBINDGEN: &str = "0.29.2";

/// From PyPI. Pinned, so that a failure is this project's.
const PACKAGES: [&str; 2] = ["cmake==4.4.5", "ninja==1.13.2"];

const VERSION: &str = env!("CARGO_PKG_VERSION");

const HEADER: &str = "wraptor/c/include/wraptor.h";

/// Where the manual's examples are.
const SECTION7: &str = "wraptor/c/examples/section7";

/// The example that downloads.
const DOWNLOAD: &str = "downloadFirmware";

/// Functions of section 7.
const FUNCTIONS: usize = 19;

const WARNINGS: [&str; 4] = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"];

const SANITIZERS: [&str; 3] = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"];

/// A hand as fast as the machine can, and the same in real time, as a host that measures or downloads needs it.
const FAST: &str = "hand --listen 127.0.0.1:0 --discovery 127.0.0.1:0 --speed max";
const REAL: &str = "hand --listen 127.0.0.1:0 --discovery 127.0.0.1:0";

/// The other ways to a hand (manual 1.5). By CAN the library's GOD runs in real time.
const SERIAL: &str = "hand --pty --speed max";
const CAN: &str = "bus --nodes 1-7 --slcan 127.0.0.1:0";

/// Examples of a way of their own: TCP, and a search in the network.
const OF_TCP: [&str; 2] = ["tcp_connect", "discoverGrasper"];

/// A language with its compiler, and the standard that examples are written for.
#[derive(Clone, Copy)]
struct Language {
    name: &'static str,
    compiler: &'static str,
    standard: &'static str,
}

const LANGUAGES: [Language; 2] = [
    Language { name: "c", compiler: "gcc", standard: "-std=c99" },
    Language { name: "c++", compiler: "g++", standard: "-std=c++17" },
];

/// Writes the header and lays out the library below target/wraptor-c.
///
/// # Errors
/// A tool is missing or fails.
pub fn c_library() -> Outcome {
    files::replace(&root().join(HEADER), header()?.as_bytes())?;
    let folder = target().join("wraptor-c");
    install(&folder, true)?;
    println!("{}: lib, include, lib/pkgconfig, lib/cmake", folder.display());
    Ok(())
}

/// Checks that the header is current, and builds and runs the examples with the library of the dev profile: a second build in release would take
/// minutes, and dev has overflow checks.
///
/// # Errors
/// The failed check with a command to repeat it, or the missing tool.
pub fn check() -> Outcome {
    let found = fs::read_to_string(root().join(HEADER)).map_err(|error| format!("{HEADER}: {error}"))?;
    if let Some(what) = difference(&found, &header()?) {
        return Err(format!("{HEADER}: {what}\n  run `cargo xtask c-library`, and commit the file"));
    }
    if !cfg!(target_os = "linux") {
        println!("skipped: the C library is laid out on Linux alone");
        return Ok(());
    }
    for (tool, package) in [("gcc", "gcc"), ("g++", "g++"), ("pkg-config", "pkg-config")] {
        if !succeeds(&format!("{tool} --version")) {
            return Err(format!("{tool} is missing\n  install it (on Debian: apt-get install {package})"));
        }
    }
    let folder = target().join("wraptor-c-check");
    install(&folder, false)?;
    let programs = section7(&folder)?;
    println!(
        "  {programs} programs of section 7's examples passed under AddressSanitizer and UBSan, over TCP, those in C on a serial port and by CAN too"
    );
    realtime(&folder)?;
    linked_statically(&folder)?;
    cmake(&folder)
}

fn header() -> Result<String, String> {
    let mut cbindgen = Command::new(installed("cbindgen", CBINDGEN)?);
    cbindgen.args(["--quiet", "--config", "wraptor/c/cbindgen.toml", "wraptor/c"]).current_dir(root());
    output(cbindgen)
}

/// Builds the library and copies it to the names that programs link, with headers, pkg-config and CMake files.
fn install(folder: &Path, is_release: bool) -> Outcome {
    // Alone: what other packages ask of nix cannot be linked statically.
    let (option, profile) = if is_release { (" --release", "release") } else { ("", "debug") };
    run(program(&format!("cargo build --quiet --package wraptor-c --lib{option}")))?;
    let built = target().join(profile);
    let (lib, package) = (folder.join("lib"), root().join("wraptor/c/package"));
    let shared = format!("libwraptor.so.{VERSION}");
    copy(&built.join("libwraptor_c.so"), &lib.join(&shared))?;
    for link in ["libwraptor.so.0", "libwraptor.so"] {
        let mut ln = program("ln --symbolic --force");
        ln.arg(&shared).arg(lib.join(link));
        run(ln)?;
    }
    copy(&built.join("libwraptor_c.a"), &lib.join("libwraptor.a"))?;
    for name in ["wraptor.h", "wraptor_compat.h"] {
        copy(&root().join("wraptor/c/include").join(name), &folder.join("include").join(name))?;
    }
    for (name, place) in [
        ("wraptor.pc", "pkgconfig"),
        ("wraptor-config.cmake", "cmake/wraptor"),
        ("wraptor-config-version.cmake", "cmake/wraptor"),
    ] {
        let path = package.join(name);
        let text = fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        write(&lib.join(place).join(name), &text.replace("@VERSION@", VERSION))?;
    }
    Ok(())
}

fn in_folder(path: &Path) -> Outcome {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

/// Copies a file, into a folder that is made.
///
/// # Errors
/// Those of the file system.
pub fn copy(from: &Path, to: &Path) -> Outcome {
    in_folder(to)?;
    fs::copy(from, to).map(drop).map_err(|error| format!("{} to {}: {error}", from.display(), to.display()))
}

fn write(path: &Path, text: &str) -> Outcome {
    in_folder(path)?;
    fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

/// The names of section 7's examples: one for each function.
///
/// # Errors
/// Others are there.
pub fn section7_examples() -> Result<Vec<String>, String> {
    let entries = fs::read_dir(root().join(SECTION7)).map_err(|error| format!("{SECTION7}: {error}"))?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.strip_suffix(".c").map(str::to_owned))
        .collect();
    names.sort();
    if names.len() != FUNCTIONS {
        return Err(format!(
            "{SECTION7}: found {names:?}, expected one file for each of {FUNCTIONS} functions"
        ));
    }
    Ok(names)
}

/// Writes what downloadFirmware's example asks for: a file and a board.
///
/// # Errors
/// The image cannot be built, or the file not written.
pub fn answers(folder: &Path) -> Result<PathBuf, String> {
    let (answers, firmware) = (folder.join("answers.txt"), host_tools::application()?);
    write(&answers, &format!("{}\n2\n", firmware.display()))?;
    Ok(answers)
}

/// A hand for an example.
///
/// # Errors
/// It cannot be started.
pub fn hand(example: &str) -> Result<Served, String> {
    // A download's monitor and host measure the same time only in real time.
    Served::new(if example == DOWNLOAD { REAL } else { FAST })
}

/// Compiles each example as C99 and as C++17 and runs it against a hand of its own over TCP, in C also on a serial port and by CAN, where the library is
/// the same. Returns the number of programs.
fn section7(folder: &Path) -> Result<usize, String> {
    let names = section7_examples()?;
    let answers = answers(folder)?;
    let [c, _] = LANGUAGES;
    let programs: Vec<(&String, Language)> =
        names.iter().flat_map(|name| LANGUAGES.map(|language| (name, language))).collect();
    let failures = in_parallel(&programs, |(name, language)| {
        let program = compile(folder, *language, Path::new(&format!("{SECTION7}/{name}.c")))?;
        let hand = hand(name)?;
        run_program(&program, place(&hand)?, &[hand.place("discovery")?], input(&answers)?)?;
        if OF_TCP.contains(&name.as_str()) || language.name != c.name {
            return Ok(());
        }
        // At 9600 baud a download takes 3 minutes (docs/wraptor.md).
        if name.as_str() != DOWNLOAD {
            let hand = Served::new(SERIAL)?;
            run_program(&program, ("serial", hand.place("pty")?), &[], input(&answers)?)?;
        }
        let boards = Served::new(CAN)?;
        run_program(&program, ("can", boards.place("slcan")?), &[], input(&answers)?).map(drop)
    });
    if failures.is_empty() { Ok(programs.len()) } else { Err(failures.join("\n")) }
}

/// # Errors
/// The file cannot be opened.
pub fn input(path: &Path) -> Result<Stdio, String> {
    File::open(path).map(Stdio::from).map_err(|error| format!("{}: {error}", path.display()))
}

/// Host and port of a hand over TCP.
///
/// # Errors
/// It has not printed them.
pub fn place(hand: &Served) -> Result<(&str, &str), String> {
    Ok(hand.place("gcl")?.split_once(':').unwrap_or_default())
}

/// Compiles a source file with the flags that pkg-config prints, and sanitizers.
fn compile(folder: &Path, language: Language, source: &Path) -> Result<PathBuf, String> {
    let mut flags = program("pkg-config --cflags --libs wraptor");
    flags.env("PKG_CONFIG_PATH", folder.join("lib/pkgconfig"));
    let flags = output(flags)?;
    let name = source.file_stem().unwrap_or_default().to_string_lossy();
    let built = folder.join("programs").join(format!("{name}-{}", language.name));
    in_folder(&built)?;
    let mut compiler = program(language.compiler);
    compiler.args(["-x", language.name, language.standard]).args(WARNINGS).args(SANITIZERS).arg(source);
    compiler.args(flags.split_whitespace()).arg(format!("-Wl,-rpath,{}", folder.join("lib").display()));
    compiler.arg("-o").arg(&built);
    run(compiler)?;
    Ok(built)
}

/// Runs a program with a hand's place and other arguments, at most a minute; returns what it prints.
fn run_program(path: &Path, place: (&str, &str), arguments: &[&str], input: Stdio) -> Result<String, String> {
    let mut command = program("timeout 60");
    command.arg(path).args([place.0, place.1]).args(arguments).stdin(input);
    let line = typed(&command);
    let ended = command.output().map_err(|error| format!("cannot start: {error}\n  repeat with: {line}"))?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    match ended.status.success() {
        true => Ok(text(&ended.stdout)),
        false => Err(format!("{line}: {}\n{}{}", ended.status, text(&ended.stdout), text(&ended.stderr))),
    }
}

/// Measures RealTime from C, after a program that is killed in the middle of its work: the hand takes the next one.
fn realtime(folder: &Path) -> Outcome {
    let [c, _] = LANGUAGES;
    let program = compile(folder, c, Path::new("wraptor/c/examples/realtime.c"))?;
    let hand = Served::new(REAL)?;
    let mut killed = self::program("timeout --signal=KILL 2");
    let (host, port) = place(&hand)?;
    killed.arg(&program).args([host, port]);
    let line = typed(&killed);
    if killed.status().is_ok_and(|status| status.success()) {
        return Err(format!("it ended before it was killed\n  repeat with: {line}"));
    }
    let said = run_program(&program, place(&hand)?, &["300", "3"], Stdio::null())?;
    said.lines().for_each(|line| println!("  {line}"));
    run_program(&program, place(&Served::emulated()?)?, &["100", "1"], Stdio::null())?;
    println!("  the same program homed a hand of emulated boards and drove them in RealTime");
    Ok(())
}

/// Links the example without shared libraries, by the flags of pkg-config.
fn linked_statically(folder: &Path) -> Outcome {
    let mut flags = program("pkg-config --static --cflags --libs wraptor");
    flags.env("PKG_CONFIG_PATH", folder.join("lib/pkgconfig"));
    let (flags, built) = (output(flags)?, folder.join("programs/grasp-static"));
    let mut compiler = program("gcc -static wraptor/c/examples/cmake/grasp.c");
    compiler.args(flags.split_whitespace()).arg("-o").arg(&built);
    // glibc warns that names of hosts are looked up by its shared libraries.
    output_of_both(compiler)?;
    run_program(&built, place(&Served::new(FAST)?)?, &[], Stdio::null()).map(drop)
}

/// Builds the example of CMake against the installation, and runs both of its programs.
fn cmake(folder: &Path) -> Outcome {
    let python = python::environment("c-library", &PACKAGES)?;
    let tool = |name: &str| python.with_file_name(name);
    let build = folder.join("cmake");
    let mut configure = Command::new(tool("cmake"));
    configure
        .args(["--fresh", "-S", "wraptor/c/examples/cmake", "-G", "Ninja", "--log-level=ERROR", "-B"])
        .arg(&build);
    configure.arg(format!("-DCMAKE_MAKE_PROGRAM={}", tool("ninja").display()));
    configure.arg(format!("-DCMAKE_PREFIX_PATH={}", folder.display())).current_dir(root());
    output(configure)?;
    let mut make = Command::new(tool("cmake"));
    make.arg("--build").arg(&build).current_dir(root());
    output(make)?;
    for name in ["grasp", "grasp_static"] {
        let text = run_program(&build.join(name), place(&Served::new(FAST)?)?, &[], Stdio::null())?;
        println!("  CMake, {name}: {}", text.trim_end());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example asks for a version that an installation takes as its own: the same first two numbers.
    #[test]
    fn example_asks_for_this_version() {
        let lists =
            std::fs::read_to_string(root().join("wraptor/c/examples/cmake/CMakeLists.txt")).expect("text");
        let (minor, _) = VERSION.rsplit_once('.').expect("three numbers");
        assert!(lists.contains(&format!("find_package(wraptor {minor} REQUIRED)")), "{lists}");
    }
}
