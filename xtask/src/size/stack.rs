//! Worst-case stack depth: of a function with its callees, and of a program with all nested interrupts.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use tater_f103::map::STACK;

use super::elf::{Program, plain};
use super::graph::{Callee, Graph, Ways};
use super::levels::Task;

/// Bytes that the processor pushes for an exception (DDI 0403E, B1.5.6): eight words, and one for alignment,
/// which revision r1p1 needs only with STKALIGN.
pub const EXCEPTION_FRAME: u32 = 36;

const RESET: u32 = 1;
const NMI: u32 = 2;
const HARD_FAULT: u32 = 3;
/// Unused words of the table: reserved, and used for the image header.
const NO_VECTORS: std::ops::RangeInclusive<u32> = 7..=10;

/// The deepest path: bytes and frames, outermost first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Deepest {
    pub bytes: u32,
    pub path: Vec<Frame>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    pub function: String,
    /// Its stack depth where it calls the next.
    pub bytes: u32,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Level {
    /// `main`, `priority 3`, `NMI` ...
    pub name: String,
    pub deepest: Deepest,
    /// Bytes pushed by the processor.
    pub pushed: u32,
}

impl Level {
    pub const fn bytes(&self) -> u32 {
        self.deepest.bytes + self.pushed
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Worst {
    /// From the lowest priority up.
    pub levels: Vec<Level>,
    /// The deepest path of the start with interrupts masked.
    pub start: Deepest,
    /// Functions that calls by a register may reach.
    pub by_register: Vec<String>,
    pub unreached: Vec<String>,
}

impl Worst {
    /// Bytes of all levels, or of the start with the exceptions that can preempt it if that is more.
    pub fn bytes(&self) -> u32 {
        let faults = self.levels.iter().filter(|level| matches!(level.name.as_str(), "HardFault" | "NMI"));
        let all: u32 = self.levels.iter().map(Level::bytes).sum();
        all.max(self.start.bytes + faults.map(Level::bytes).sum::<u32>())
    }

    /// Free bytes of the stack; negative if it is too small.
    pub fn margin(&self) -> i32 {
        STACK.len.cast_signed() - self.bytes().cast_signed()
    }

    pub fn margin_percent(&self) -> f64 {
        100.0 * f64::from(self.margin()) / f64::from(STACK.len)
    }
}

/// Result for a function entered with interrupts masked or not.
#[derive(Debug, Default)]
struct Known {
    all: Deepest,
    open: Deepest,
    opens: bool,
}

struct Analysis<'p> {
    graph: Rc<Graph<'p>>,
    known: BTreeMap<(u32, bool), Rc<Known>>,
    ways: Vec<(u32, Rc<Ways>)>,
    active: Vec<u32>,
}

/// # Errors
/// Code that cannot be followed, a recursion, or an interrupt of unknown priority.
pub fn worst(program: &Program, tasks: &[Task]) -> Result<Worst, String> {
    let mut analysis = Analysis {
        graph: Rc::new(Graph::new(program)),
        known: BTreeMap::new(),
        ways: Vec::new(),
        active: Vec::new(),
    };
    let table = program.sections.iter().find(|section| section.name == ".vector_table");
    let table = table.ok_or("found no section .vector_table, expected one")?;
    let vector =
        |number: u32| program.word(table.start + 4 * number).filter(|&word| word != 0).map(|word| word & !1);
    let mut levels = BTreeMap::new();
    for number in (2..table.len / 4).filter(|number| !NO_VECTORS.contains(number)) {
        let Some(at) = vector(number) else { continue };
        let (place, name) = level(program, number, at, tasks)?;
        let deepest = analysis.known(at, false)?.all.clone();
        let level = Level { name, deepest, pushed: EXCEPTION_FRAME };
        let deeper = |known: &Level| known.deepest.bytes >= level.deepest.bytes;
        if !levels.get(&place).is_some_and(deeper) {
            levels.insert(place, level);
        }
    }
    let reset = vector(RESET).ok_or("found no reset vector, expected one")?;
    let main = analysis.known(reset, false)?;
    let bottom = Level { name: "main".into(), deepest: main.open.clone(), pushed: 0 };
    analysis.complete()?;
    let graph = Rc::clone(&analysis.graph);
    let reached = |start: u32, end: u32| analysis.ways.iter().any(|(at, _)| (start..end).contains(at));
    let idle = graph.functions().iter().filter(|function| !reached(function.start, function.end));
    Ok(Worst {
        levels: std::iter::once(bottom).chain(levels.into_values()).collect(),
        start: main.all.clone(),
        // Instances of one function for several types share a name.
        by_register: graph
            .taken
            .iter()
            .map(|&at| graph.name(at))
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect(),
        unreached: idle.map(|function| function.name.clone()).collect(),
    })
}

/// Order and name of a handler's level. Unused interrupts rank above the tasks: they stop the program.
fn level(program: &Program, number: u32, at: u32, tasks: &[Task]) -> Result<(u32, String), String> {
    let names: Vec<&str> = program.names(at).map(|symbol| symbol.name.as_str()).collect();
    match (number, tasks.iter().find(|task| names.contains(&task.binds.as_str()))) {
        (NMI, _) => Ok((u32::MAX, "NMI".into())),
        (HARD_FAULT, _) => Ok((u32::MAX - 1, "HardFault".into())),
        _ if names.contains(&"DefaultHandler") => Ok((u32::MAX - 2, "unbound".into())),
        (_, Some(task)) => Ok((task.priority, format!("priority {}", task.priority))),
        _ => Err(format!(
            "found vector {number} with handler {}, expected one of the tasks of boards/tater-f103/src/app.rs",
            names.first().map_or_else(|| format!("{at:#010x}"), |name| plain(name))
        )),
    }
}

impl Analysis<'_> {
    fn opens(&mut self, callee: Callee) -> Result<bool, String> {
        let mut opens = false;
        for at in self.targets(callee) {
            opens |= self.known(at, true)?.opens;
        }
        Ok(opens)
    }

    fn targets(&self, callee: Callee) -> Vec<u32> {
        match callee {
            Callee::At(at) => vec![at],
            Callee::Any => self.graph.taken.iter().copied().collect(),
        }
    }

    /// Depth of a function from an entry, with its callees.
    fn known(&mut self, at: u32, masked: bool) -> Result<Rc<Known>, String> {
        if let Some(known) = self.known.get(&(at, masked)) {
            return Ok(Rc::clone(known));
        }
        let graph = Rc::clone(&self.graph);
        if let Some(first) = self.active.iter().position(|&active| active == at) {
            let names: Vec<String> = self.active[first..].iter().map(|&at| graph.name(at)).collect();
            return Err(format!("found a recursion, expected none: {}", names.join(" > ")));
        }
        self.active.push(at);
        let ways = Rc::new(graph.ways(at, masked, &mut |callee| self.opens(callee))?);
        let frame = |bytes: i32| Frame { function: graph.name(at), bytes: u32::try_from(bytes).unwrap_or(0) };
        let own = |bytes: i32| Deepest { bytes: frame(bytes).bytes, path: vec![frame(bytes)] };
        let mut known = Known { all: own(ways.deepest), open: own(ways.deepest_open), opens: ways.opens };
        for call in ways.calls.values() {
            for to in self.targets(call.callee) {
                let callee = self.known(to, call.masked)?;
                deepen(&mut known.all, &frame(call.depth), &callee.all);
                // A callee that enables interrupts does so at its own depth.
                if !call.masked || callee.opens {
                    deepen(&mut known.open, &frame(call.depth), &callee.open);
                }
            }
        }
        self.active.pop();
        self.ways.push((at, ways));
        let known = Rc::new(known);
        self.known.insert((at, masked), Rc::clone(&known));
        Ok(known)
    }

    /// Checks that no instruction of a reached function was missed.
    fn complete(&self) -> Result<(), String> {
        for function in self.graph.functions() {
            let inside = |&&(at, _): &&(u32, Rc<Ways>)| (function.start..function.end).contains(&at);
            let ways: Vec<&Ways> = self.ways.iter().filter(inside).map(|(_, ways)| ways.as_ref()).collect();
            if let Some(at) = self.graph.missed(function, &ways).filter(|_| !ways.is_empty()) {
                return Err(format!(
                    "{} at {at:#010x}: found an instruction on no path: a jump was missed",
                    function.name
                ));
            }
        }
        Ok(())
    }
}

fn deepen(deepest: &mut Deepest, frame: &Frame, callee: &Deepest) {
    let bytes = frame.bytes + callee.bytes;
    if bytes > deepest.bytes {
        *deepest = Deepest { bytes, path: [std::slice::from_ref(frame), &callee.path].concat() };
    }
}

#[cfg(test)]
mod tests;
