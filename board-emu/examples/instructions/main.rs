//! Generates random instructions and executes them one by one: writes state before and after, for another
//! core to repeat (tests/host/instructions.py).
//!
//! `instructions OUT SEED STEPS` writes at least STEPS results to OUT. All numbers are little-endian. The
//! file is a sequence of batches: the flash contents, a count of cases, the cases. A case is its 17 registers
//! (0 to 15 and xPSR), the memory window, a count of steps, and for each step the 17 registers after it and a
//! byte: 1 if the window has changed, followed by the window.

mod alu;
mod case;
mod make;
mod memory;

use std::path::Path;

use board_emu::chip::Chip;
use board_emu::cpu::Cpu;
use case::{Case, Random, SLOT, WINDOW, WINDOW_LEN};

/// Cases in a batch, and address of the first: literals reach 4 KiB either way.
const CASES: usize = 1800;
const FIRST: u32 = 0x0800_2000;

const REGISTERS: usize = 17;

fn main() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let usage = || "usage: instructions OUT SEED STEPS".to_owned();
    let [out, seed, steps] = arguments.as_slice() else { return Err(usage()) };
    let (seed, steps): (u64, usize) =
        (seed.parse().map_err(|_| usage())?, steps.parse().map_err(|_| usage())?);
    let mut random = Random::new(seed);
    let (mut bytes, mut done) = (Vec::new(), 0);
    while done < steps {
        done += batch(&mut random, &mut bytes)?;
    }
    programs::files::replace(Path::new(out), &bytes).map_err(|error| format!("{out}: {error}"))?;
    println!("{done} instructions");
    Ok(())
}

/// Returns the number of instructions.
fn batch(random: &mut Random, out: &mut Vec<u8>) -> Result<usize, String> {
    let mut chip = Chip::new(1, [0; 3]);
    let cases: Vec<Case> = (0..CASES).map(|i| make::make(random, FIRST + i as u32 * SLOT)).collect();
    for byte in &mut chip.flash.bytes {
        *byte = random.below(256) as u8;
    }
    for case in &cases {
        let at = (case.address() - 0x0800_0000) as usize;
        let code: Vec<u8> = case.code.iter().flat_map(|half| half.to_le_bytes()).collect();
        chip.flash.bytes[at..at + code.len()].copy_from_slice(&code);
    }
    out.extend(&chip.flash.bytes);
    out.extend((cases.len() as u32).to_le_bytes());
    let mut cpu = Cpu::new(chip);
    let mut steps = 0;
    for case in &cases {
        steps += run(&mut cpu, case, out)?;
    }
    Ok(steps)
}

fn run(cpu: &mut Cpu, case: &Case, out: &mut Vec<u8>) -> Result<usize, String> {
    for (index, value) in case.registers.iter().enumerate() {
        cpu.set_register(index, *value);
    }
    let at = (WINDOW - 0x2000_0000) as usize..(WINDOW - 0x2000_0000) as usize + WINDOW_LEN;
    cpu.chip.ram[at.clone()].copy_from_slice(&case.window);
    save(cpu, out);
    out.extend(&case.window);
    let count_at = out.len();
    out.push(0);
    let (mut window, mut steps) = (case.window.clone(), 0);
    let (mut at_half, start) = (0, case.address());
    // Until the end or a branch, which is not followed.
    while at_half < case.code.len() && cpu.pc() == start + 2 * at_half as u32 {
        at_half += if case.code[at_half] >> 11 >= 0b11101 { 2 } else { 1 };
        cpu.step().map_err(|problem| format!("{problem}: {:04x?} at {:#010x}", case.code, cpu.pc()))?;
        steps += 1;
        save(cpu, out);
        let now = &cpu.chip.ram[at.clone()];
        out.push(u8::from(*now != *window));
        if *now != *window {
            out.extend(now);
            window.copy_from_slice(now);
        }
    }
    out[count_at] = steps as u8;
    Ok(steps)
}

fn save(cpu: &Cpu, out: &mut Vec<u8>) {
    for index in 0..REGISTERS {
        out.extend(cpu.register(index).to_le_bytes());
    }
}
