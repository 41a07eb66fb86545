//! The functions of a program and the paths through each: calls, and the stack depth at each call.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::elf::{Program, plain};
use super::thumb::{Flow, Instruction, Mask, PC, Stack, decode};

/// Bytes of stack that no microcontroller has.
const MOST_DEPTH: i32 = 1 << 20;

/// Instructions that load the stack pointer with a value that static analysis cannot know, and why that is right.
const STACK_RESET: [(&str, &str); 2] = [
    ("HardFault", "begins the stack anew, because it may be what has failed, and never returns"),
    ("cortex_m::asm::bootload", "leaves the monitor for the application, which begins its own"),
];

/// Functions that leave the program by a jump that static analysis cannot follow.
const LEAVES: [(&str, &str); 1] = [("cortex_m::asm::bootload", "to the application's reset vector")];

/// Error for a jump that is neither a call nor a table jump.
const UNKNOWN_JUMP: &str = "found a jump by a register, expected a table of jumps behind a MOV to the program counter; state where it \
                       goes in LEAVES";

/// A function: the bytes of its symbol. Assembler code without symbol lengths is one function with several
/// entries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Function {
    pub name: String,
    pub start: u32,
    pub end: u32,
    /// Assembler code, possibly entered in the middle.
    assembled: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Callee {
    At(u32),
    /// By a register: any function whose address is taken.
    Any,
}

/// A call, or a jump to another function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Call {
    pub callee: Callee,
    /// Stack depth in bytes at the call.
    pub depth: i32,
    /// Interrupts are masked (PRIMASK).
    pub masked: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct State {
    depth: i32,
    masked: bool,
    /// Conditional instructions that follow (IT).
    conditional: u32,
    /// No effect since a call, which may not return.
    called: bool,
}

/// All paths through a function from one entry.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Ways {
    /// Calls by address of the instruction.
    pub calls: BTreeMap<u32, Call>,
    /// Largest stack depth, bytes.
    pub deepest: i32,
    /// The same while interrupts are enabled.
    pub deepest_open: i32,
    /// It may enable interrupts.
    pub opens: bool,
    reached: BTreeSet<u32>,
}

pub struct Graph<'p> {
    program: &'p Program,
    functions: Vec<Function>,
    /// Functions whose address is taken: possible targets of a call by a register.
    pub taken: BTreeSet<u32>,
}

impl<'p> Graph<'p> {
    pub fn new(program: &'p Program) -> Self {
        let mut graph = Self { program, functions: functions(program), taken: BTreeSet::new() };
        graph.taken = graph.taken();
        graph
    }

    pub fn function(&self, address: u32) -> Option<&Function> {
        let next = self.functions.partition_point(|function| function.start <= address);
        self.functions[..next].last().filter(|function| address < function.end)
    }

    pub fn name(&self, address: u32) -> String {
        let exact =
            self.program.names(address).find(|symbol| symbol.function).map(|symbol| plain(&symbol.name));
        exact
            .or_else(|| Some(self.function(address)?.name.clone()))
            .unwrap_or_else(|| format!("{address:#010x}"))
    }

    pub fn functions(&self) -> &[Function] {
        &self.functions
    }

    /// Functions whose address is a word of constants, initial values or literal pools, or is built by MOVW
    /// and MOVT. The vector table does not count: only the processor calls those.
    fn taken(&self) -> BTreeSet<u32> {
        let mut words = BTreeSet::new();
        for section in self.program.sections.iter().filter(|section| section.name != ".vector_table") {
            for at in (section.start.next_multiple_of(4)..section.end()).step_by(4) {
                if !self.program.is_code(at) {
                    words.extend(self.program.word(at));
                }
            }
        }
        for function in &self.functions {
            // MOVT keeps the lower half: combine it with every MOVW of the function to the same register. Few
            // of the results are addresses of functions by accident.
            let halves: Vec<_> = self.instructions(function).filter_map(|(_, found)| found.half).collect();
            for upper in halves.iter().filter(|half| half.upper) {
                let lower = halves.iter().filter(|half| !half.upper && half.register == upper.register);
                words.extend(lower.map(|lower| u32::from(upper.value) << 16 | u32::from(lower.value)));
            }
        }
        let entry = |word: &u32| word & 1 == 1 && self.program.names(word & !1).any(|symbol| symbol.function);
        words.into_iter().filter(entry).map(|word| word & !1).collect()
    }

    /// The shortest call chain to a function, by names, from one that nothing calls; the function comes last.
    pub fn chain(&self, to: u32) -> Vec<String> {
        let mut callers: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        for function in &self.functions {
            for (_, found) in self.instructions(function) {
                if let Flow::Call(to) | Flow::Jump(to) | Flow::Branch(to) = found.flow
                    && let Some(callee) = self.function(to).filter(|callee| *callee != function)
                {
                    callers.entry(callee.start).or_default().insert(function.start);
                }
            }
        }
        let mut chains = VecDeque::from([vec![to]]);
        let mut seen = BTreeSet::from([to]);
        while let Some(chain) = chains.pop_front() {
            let Some(above) = chain.last().and_then(|first| callers.get(first)) else {
                return chain.iter().rev().map(|&at| self.name(at)).collect();
            };
            chains.extend(
                above.iter().filter(|&&at| seen.insert(at)).map(|&at| [chain.as_slice(), &[at]].concat()),
            );
        }
        vec![self.name(to)]
    }

    /// The instructions of a function in order, without data.
    fn instructions(&self, function: &Function) -> impl Iterator<Item = (u32, Instruction)> {
        let mut at = function.start;
        let end = function.end;
        std::iter::from_fn(move || {
            while at < end && !self.program.is_code(at) {
                at = self.program.next_code(at).unwrap_or(end);
            }
            let found = (at < end).then(|| decode(at, self.program.bytes(at))).flatten()?;
            at += found.len;
            Some((at - found.len, found))
        })
    }

    /// Follows all paths from an entry. `opens` tells whether a callee may enable interrupts.
    ///
    /// # Errors
    /// An instruction that cannot be followed, with its address.
    pub fn ways(
        &self,
        entry: u32,
        masked: bool,
        opens: &mut dyn FnMut(Callee) -> Result<bool, String>,
    ) -> Result<Ways, String> {
        let function = self
            .function(entry)
            .ok_or_else(|| format!("found a jump to {entry:#010x}, where there is no function"))?;
        let mut walk = Walk { graph: self, function, ways: Ways::default(), states: BTreeMap::new() };
        let mut open = vec![(entry, State { depth: 0, masked, conditional: 0, called: false })];
        while let Some((at, state)) = open.pop() {
            let wrong = |what: String| format!("{} at {at:#010x}: {what}", function.name);
            walk.step(at, state, &mut open, opens).map_err(wrong)?;
        }
        walk.ways.reached = walk.states.into_keys().collect();
        Ok(walk.ways)
    }

    /// The first instruction on no followed path, if any: a jump was missed.
    pub fn missed(&self, function: &Function, ways: &[&Ways]) -> Option<u32> {
        let unknown = |&(at, found): &(u32, Instruction)| {
            found.flow != Flow::Trap && !found.nop && !ways.iter().any(|ways| ways.reached.contains(&at))
        };
        if function.assembled { None } else { self.instructions(function).find(unknown).map(|(at, _)| at) }
    }
}

fn functions(program: &Program) -> Vec<Function> {
    let mut functions: Vec<Function> = Vec::new();
    let inside = |start: u32| program.section(start).filter(|section| section.code);
    let symbols: Vec<_> = program.symbols.iter().filter(|symbol| symbol.function).collect();
    for (index, symbol) in symbols.iter().enumerate() {
        let Some(section) = inside(symbol.start) else { continue };
        let later = symbols[index..].iter().find(|later| later.start > symbol.start);
        let next = later.map_or(section.end(), |later| later.start.min(section.end()));
        let assembled = symbol.len == 0;
        match functions.last_mut() {
            // Another name for the same place.
            Some(last) if symbol.start < last.end && symbol.start == last.start => {}
            Some(last) if assembled && last.assembled && last.end == symbol.start => last.end = next,
            Some(last) if symbol.start < last.end => {}
            _ => {
                let end = if assembled { next } else { symbol.start + symbol.len };
                functions.push(Function { name: plain(&symbol.name), start: symbol.start, end, assembled });
            }
        }
    }
    functions
}

struct Walk<'g, 'p> {
    graph: &'g Graph<'p>,
    function: &'g Function,
    ways: Ways,
    states: BTreeMap<u32, State>,
}

/// Successors of an instruction other than the next.
type Open = Vec<(u32, State)>;

impl Walk<'_, '_> {
    /// Executes an instruction, unless a deeper state was seen there before.
    fn step(
        &mut self,
        at: u32,
        state: State,
        open: &mut Open,
        opens: &mut dyn FnMut(Callee) -> Result<bool, String>,
    ) -> Result<(), String> {
        if at >= self.function.end || !self.graph.program.is_code(at) {
            return if state.called { Ok(()) } else { Err("found data, expected an instruction".into()) };
        }
        let Some(state) = self.worse(at, state)? else { return Ok(()) };
        let found = decode(at, self.graph.program.bytes(at)).ok_or("found half an instruction")?;
        let optional = state.conditional > 0;
        let mut after = State {
            conditional: found.conditional.max(state.conditional.saturating_sub(1)),
            called: state.called && found.nop,
            ..state
        };
        after.depth = match found.stack {
            // Conditional: assume the deeper outcome. A conditional return has already released its part.
            Stack::Grows(bytes) if optional => state.depth + bytes.max(0),
            Stack::Grows(bytes) => state.depth + bytes,
            Stack::Set if listed(&STACK_RESET, &self.function.name) => 0,
            Stack::Set => {
                return Err(
                    "found a stack pointer set to an unknown value; give the reason in STACK_RESET".into()
                );
            }
        };
        match found.mask {
            Mask::Same => {}
            Mask::Set => after.masked = !optional || state.masked,
            Mask::Clear => {
                after.masked = false;
                self.ways.opens = true;
            }
        }
        self.ways.deepest = self.ways.deepest.max(after.depth);
        if !after.masked {
            self.ways.deepest_open = self.ways.deepest_open.max(after.depth).max(state.depth);
        }
        self.follow(at, &found, after, open, opens, optional)
    }

    /// The state to continue with; `None` if it adds nothing.
    fn worse(&mut self, at: u32, state: State) -> Result<Option<State>, String> {
        let Some(known) = self.states.get(&at) else {
            self.states.insert(at, state);
            return Ok(Some(state));
        };
        let both = State {
            depth: known.depth.max(state.depth),
            masked: known.masked && state.masked,
            conditional: known.conditional.max(state.conditional),
            called: known.called && state.called,
        };
        if both == *known {
            return Ok(None);
        }
        // It would grow without end.
        if both.depth > MOST_DEPTH {
            return Err("found a loop that pushes without end".into());
        }
        self.states.insert(at, both);
        Ok(Some(both))
    }

    fn follow(
        &mut self,
        at: u32,
        found: &Instruction,
        after: State,
        open: &mut Open,
        opens: &mut dyn FnMut(Callee) -> Result<bool, String>,
        optional: bool,
    ) -> Result<(), String> {
        let next = (at + found.len, after);
        match found.flow {
            Flow::Next => open.push(next),
            Flow::Call(_) | Flow::CallRegister => {
                let callee = if let Flow::Call(to) = found.flow { Callee::At(to) } else { Callee::Any };
                self.ways.calls.insert(at, Call { callee, depth: after.depth, masked: after.masked });
                let opened = opens(callee)?;
                self.ways.opens |= opened;
                let masked = after.masked && !opened;
                open.push((at + found.len, State { called: true, masked, ..after }));
            }
            Flow::Jump(to) | Flow::Branch(to) => {
                self.jump(at, to, after, open, opens)?;
                if optional || found.flow != Flow::Jump(to) {
                    open.push(next);
                }
            }
            Flow::Table { wide, register } => {
                let from = at + found.len;
                let table = if register == PC { Some(from) } else { self.address_in(register, at) };
                let targets = self.table(from, table.ok_or(UNKNOWN_JUMP)?, wide)?;
                open.extend(targets.into_iter().map(|to| (to, after)));
            }
            Flow::Return if optional => open.push(next),
            Flow::Return | Flow::Trap => {}
            Flow::LastCallRegister | Flow::JumpAmong | Flow::JumpRegister
                if listed(&LEAVES, &self.function.name) => {}
            Flow::LastCallRegister => {
                self.last_call(at, Callee::Any, after, opens)?;
                if optional {
                    open.push(next);
                }
            }
            Flow::JumpAmong => {
                open.extend(self.jumps(at + found.len)?.into_iter().map(|to| (to, after)));
                if optional {
                    open.push(next);
                }
            }
            Flow::JumpRegister => return Err(UNKNOWN_JUMP.into()),
            Flow::Exception => {
                return Err("found SVC, expected none: the level of its handler is unknown".into());
            }
            Flow::Unknown => return Err("found an instruction that a Cortex-M3 lacks".into()),
        }
        Ok(())
    }

    /// A jump within the function, or a tail call.
    fn jump(
        &mut self,
        at: u32,
        to: u32,
        after: State,
        open: &mut Open,
        opens: &mut dyn FnMut(Callee) -> Result<bool, String>,
    ) -> Result<(), String> {
        if (self.function.start..self.function.end).contains(&to) {
            open.push((to, after));
            return Ok(());
        }
        self.last_call(at, Callee::At(to), after, opens)
    }

    fn last_call(
        &mut self,
        at: u32,
        callee: Callee,
        after: State,
        opens: &mut dyn FnMut(Callee) -> Result<bool, String>,
    ) -> Result<(), String> {
        self.ways.calls.insert(at, Call { callee, depth: after.depth, masked: after.masked });
        self.ways.opens |= opens(callee)?;
        Ok(())
    }

    /// The address that the last ADR before an instruction gave to a register. Another way may give it another one: [`Graph::missed`] would find
    /// that.
    fn address_in(&self, register: u16, before: u32) -> Option<u32> {
        let given = self.graph.instructions(self.function).take_while(|&(at, _)| at < before);
        let given =
            given.filter_map(|(_, found)| found.address.filter(|address| address.register == register));
        given.last().map(|address| address.value)
    }

    /// Targets of TBB or TBH: offsets in half-words from the next instruction in a table, which ends where code begins. The byte that pads an
    /// odd table is an offset of 0.
    fn table(&self, from: u32, table: u32, wide: bool) -> Result<BTreeSet<u32>, String> {
        let end = self.graph.program.next_code(table).unwrap_or(self.function.end).min(self.function.end);
        let len = usize::try_from(end.saturating_sub(table)).unwrap_or(0);
        let bytes = self.graph.program.bytes(table).get(..len).unwrap_or_default();
        let distances: Vec<u16> = if wide {
            bytes.as_chunks().0.iter().map(|&pair| u16::from_le_bytes(pair)).collect()
        } else {
            bytes.iter().map(|&byte| u16::from(byte)).collect()
        };
        let targets: BTreeSet<u32> = distances
            .iter()
            .filter(|&&distance| distance > 0)
            .map(|&distance| from + 2 * u32::from(distance))
            // Constants may follow the table in the same data. Where one of them points at code, more ways are followed than there are.
            .filter(|&to| to < self.function.end && self.graph.program.is_code(to))
            .collect();
        if targets.is_empty() {
            return Err("found a table jump without a table".into());
        }
        Ok(targets)
    }

    /// The 32-bit jumps that follow a MOV to PC: its targets.
    fn jumps(&self, after: u32) -> Result<Vec<u32>, String> {
        let program = self.graph.program;
        let jump = |at: &u32| {
            let found = decode(*at, program.bytes(*at));
            *at < self.function.end
                && program.is_code(*at)
                && found.is_some_and(|found| found.len == 4 && matches!(found.flow, Flow::Jump(_)))
        };
        let jumps: Vec<u32> = (after.next_multiple_of(4)..).step_by(4).take_while(jump).collect();
        if jumps.is_empty() { Err(UNKNOWN_JUMP.into()) } else { Ok(jumps) }
    }
}

fn listed(table: &[(&str, &str)], name: &str) -> bool {
    table.iter().any(|&(listed, _)| listed == name)
}

#[cfg(test)]
pub mod tests;
