//! The functions of a program and the paths through each: the stack depth at each call, and the callee.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::elf::{Program, plain};
use super::thumb::{Flow, Instruction, Mask, Stack, decode};

/// Instructions that set the stack pointer to a value that static analysis does not find: their effect, and
/// why it is correct.
const STACK_BEGUN_ANEW: [(&str, &str); 2] = [
    ("HardFault", "begins the stack anew, because it may be what has failed, and never returns"),
    ("cortex_m::asm::bootload", "leaves the monitor for the application, which begins its own"),
];

/// Functions that leave the program by a jump that static analysis does not find.
const LEAVES: [(&str, &str); 1] = [("cortex_m::asm::bootload", "to the application's reset vector")];

/// Error text for a jump that is neither a call nor by a table.
const NOWHERE: &str = "found a jump by a register, expected a table of jumps behind a MOV to the program counter; state where it \
                       goes in LEAVES";

/// A function: the bytes of its symbol. Assembler code without a length is one function with several entries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Function {
    pub name: String,
    pub start: u32,
    pub end: u32,
    /// Assembler code, entered in the middle.
    assembled: bool,
}

/// The target of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Callee {
    At(u32),
    /// By a register: any function whose address exists as data.
    Any,
}

/// A call, or a jump into another function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Call {
    pub callee: Callee,
    /// Bytes on the stack at this point.
    pub depth: i32,
    /// Interrupts are masked here (PRIMASK).
    pub masked: bool,
}

/// State of the stack on entry to an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct State {
    depth: i32,
    masked: bool,
    /// Number of conditional instructions left.
    conditional: u32,
    /// Nothing was executed since a call, which may never return.
    called: bool,
}

/// All paths through a function from one entry.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Ways {
    /// By the address of the instruction.
    pub calls: BTreeMap<u32, Call>,
    /// Maximum bytes on the stack.
    pub deepest: i32,
    /// The same, where interrupts are enabled.
    pub deepest_open: i32,
    /// It contains an instruction that may enable interrupts.
    pub opens: bool,
    /// The addresses of its instructions.
    reached: BTreeSet<u32>,
}

/// The functions of a program.
pub struct Graph<'p> {
    program: &'p Program,
    functions: Vec<Function>,
    /// Possible targets of a call by a register.
    pub taken: BTreeSet<u32>,
}

impl<'p> Graph<'p> {
    /// Finds the functions.
    pub fn new(program: &'p Program) -> Self {
        let mut graph = Self { program, functions: functions(program), taken: BTreeSet::new() };
        graph.taken = graph.taken();
        graph
    }

    /// The function at an address.
    pub fn function(&self, address: u32) -> Option<&Function> {
        let next = self.functions.partition_point(|function| function.start <= address);
        self.functions[..next].last().filter(|function| address < function.end)
    }

    /// A name for an address of a function.
    pub fn name(&self, address: u32) -> String {
        let exact =
            self.program.names(address).find(|symbol| symbol.function).map(|symbol| plain(&symbol.name));
        exact
            .or_else(|| Some(self.function(address)?.name.clone()))
            .unwrap_or_else(|| format!("{address:#010x}"))
    }

    /// All functions.
    pub fn functions(&self) -> &[Function] {
        &self.functions
    }

    /// The functions whose address is a word of the constants, of the variables' initial values or of a
    /// literal pool, or is put together by MOVW and MOVT in some function. The vector table does not count:
    /// the processor calls those.
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
            // MOVT keeps the lower half of its register, which any MOVW of the function may have written on
            // some path. Not all pairs are constants of the program; few of the others are addresses of
            // functions.
            let halves: Vec<_> = self.instructions(function).filter_map(|(_, found)| found.half).collect();
            for upper in halves.iter().filter(|half| half.upper) {
                let lower = halves.iter().filter(|half| !half.upper && half.register == upper.register);
                words.extend(lower.map(|lower| u32::from(upper.value) << 16 | u32::from(lower.value)));
            }
        }
        let entry = |word: &u32| word & 1 == 1 && self.program.names(word & !1).any(|symbol| symbol.function);
        words.into_iter().filter(entry).map(|word| word & !1).collect()
    }

    /// The shortest chain of calls to a function from one that nothing calls, by the names in direct calls
    /// and jumps. The function itself is the last.
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

    /// Follows all paths from an entry. `opens` returns whether a callee may enable interrupts.
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

    /// The first instruction of a function that no followed path reaches: a jump has been missed.
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
            // Another name for the same address.
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

/// One function being followed.
struct Walk<'g, 'p> {
    graph: &'g Graph<'p>,
    function: &'g Function,
    ways: Ways,
    states: BTreeMap<u32, State>,
}

/// The successors of an instruction within its function, except the next one.
type Open = Vec<(u32, State)>;

impl Walk<'_, '_> {
    /// Executes one instruction in a state, unless it has been in a worse one.
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
            // Executed or not: take the larger. A path that leaves the function here has released its stack.
            Stack::Grows(bytes) if optional => state.depth + bytes.max(0),
            Stack::Grows(bytes) => state.depth + bytes,
            Stack::Set if listed(&STACK_BEGUN_ANEW, &self.function.name) => 0,
            Stack::Set => {
                return Err(
                    "found a stack pointer set to what cannot be known; state why in STACK_BEGUN_ANEW".into(),
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

    /// The state to continue with; none if it contains nothing new.
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
        // More than the RAM: it would grow forever.
        if both.depth > tater_wire::memory::RAM.len.cast_signed() {
            return Err("found a loop that takes more stack each time".into());
        }
        self.states.insert(at, both);
        Ok(Some(both))
    }

    /// The target of the instruction.
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
            Flow::Table { wide } => {
                let targets = self.table(at + found.len, wide)?;
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
            Flow::JumpRegister => return Err(NOWHERE.into()),
            Flow::Exception => {
                return Err(
                    "found SVC, expected none: the exception's handler is a level of no priority".into()
                );
            }
            Flow::Unknown => return Err("found what is no instruction of a Cortex-M3".into()),
        }
        Ok(())
    }

    /// A jump: within the function, or a tail call.
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

    /// A jump into another function, which returns to this function's caller.
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

    /// The targets of TBB or TBH: distances in half-words from the table, which ends where code begins. The
    /// padding byte of an odd table is a distance of 0, which would be the table itself.
    fn table(&self, table: u32, wide: bool) -> Result<BTreeSet<u32>, String> {
        let end = self.graph.program.next_code(table).unwrap_or(self.function.end).min(self.function.end);
        let len = usize::try_from(end.saturating_sub(table)).unwrap_or(0);
        let bytes = self.graph.program.bytes(table).get(..len).unwrap_or_default();
        let distances: Vec<u16> = if wide {
            bytes.as_chunks().0.iter().map(|&pair| u16::from_le_bytes(pair)).collect()
        } else {
            bytes.iter().map(|&byte| byte.into()).collect()
        };
        let targets: BTreeSet<u32> = distances
            .iter()
            .filter(|&&distance| distance > 0)
            .map(|&distance| table + 2 * u32::from(distance))
            .collect();
        if targets.is_empty() {
            return Err("found a jump by a table, and no table behind it".into());
        }
        Ok(targets)
    }

    /// The 32-bit jumps that follow a MOV to the program counter, which are its targets.
    fn jumps(&self, after: u32) -> Result<Vec<u32>, String> {
        let program = self.graph.program;
        let jump = |at: &u32| {
            let found = decode(*at, program.bytes(*at));
            *at < self.function.end
                && program.is_code(*at)
                && found.is_some_and(|found| found.len == 4 && matches!(found.flow, Flow::Jump(_)))
        };
        let jumps: Vec<u32> = (after.next_multiple_of(4)..).step_by(4).take_while(jump).collect();
        if jumps.is_empty() { Err(NOWHERE.into()) } else { Ok(jumps) }
    }
}

/// Whether a table names a function.
fn listed(table: &[(&str, &str)], name: &str) -> bool {
    table.iter().any(|&(listed, _)| listed == name)
}

#[cfg(test)]
pub mod tests;
