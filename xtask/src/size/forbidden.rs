//! Code that must not be in a production image: panics, floating point, a heap. The linker keeps a symbol
//! only if something refers to it, so the absence of these names proves that nothing calls them.

use super::elf::plain;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    Panic,
    Float,
    Heap,
}

impl Family {
    pub const fn name(self) -> &'static str {
        match self {
            Self::Panic => "panic",
            Self::Float => "floating point",
            Self::Heap => "heap",
        }
    }
}

/// Symbols that are allowed, each with a reason.
pub const ALLOWED: [(&str, &str); 0] = [];

/// Parts of Rust names. `rust_begin_unwind` is the panic handler.
const PATHS: [(&str, Family); 20] = [
    ("core::panicking::", Family::Panic),
    ("core::panic::", Family::Panic),
    ("std::panicking::", Family::Panic),
    ("rust_begin_unwind", Family::Panic),
    ("rust_panic", Family::Panic),
    ("rust_eh_personality", Family::Panic),
    ("::unwrap_failed", Family::Panic),
    ("::expect_failed", Family::Panic),
    ("core::slice::index::slice_", Family::Panic),
    ("core::slice::copy_from_slice_impl::len_mismatch_fail", Family::Panic),
    ("core::str::slice_error_fail", Family::Panic),
    ("core::cell::panic_", Family::Panic),
    ("compiler_builtins::float::", Family::Float),
    ("compiler_builtins::math::", Family::Float),
    ("core::num::flt2dec::", Family::Float),
    ("libm::", Family::Float),
    ("alloc::", Family::Heap),
    ("__rust_alloc", Family::Heap),
    ("__rust_dealloc", Family::Heap),
    ("__rust_realloc", Family::Heap),
];

/// Prefixes of ARM's run-time ABI (IHI 0043, 4.1.2: floating-point helpers) and of libgcc. Integer helpers
/// begin otherwise: `__aeabi_i`, `_u`, `_l` and a verb.
const FLOATS: [&str; 18] = [
    "__aeabi_f",
    "__aeabi_d",
    "__aeabi_cf",
    "__aeabi_cd",
    "__aeabi_h2f",
    "__aeabi_i2f",
    "__aeabi_ui2f",
    "__aeabi_l2f",
    "__aeabi_ul2f",
    "__aeabi_i2d",
    "__aeabi_ui2d",
    "__aeabi_l2d",
    "__aeabi_ul2d",
    "__fix",
    "__float",
    "__extend",
    "__trunc",
    "__powi",
];

const HEAPS: [&str; 9] =
    ["malloc", "calloc", "realloc", "free", "memalign", "aligned_alloc", "posix_memalign", "_sbrk", "sbrk"];

pub fn family(symbol: &str) -> Option<Family> {
    let name = plain(symbol);
    if ALLOWED.iter().any(|&(allowed, _)| allowed == name) {
        return None;
    }
    if let Some(&(_, family)) = PATHS.iter().find(|(part, _)| path(&name, part)) {
        return Some(family);
    }
    if FLOATS.iter().any(|start| symbol.starts_with(start)) || is_gnu_float(symbol) {
        return Some(Family::Float);
    }
    let is_heap = HEAPS.contains(&symbol) || symbol.starts_with("__rdl_") || symbol.starts_with("__rg_");
    is_heap.then_some(Family::Heap)
}

/// Whether a name contains `part` at the start of a word.
fn path(name: &str, part: &str) -> bool {
    let word = |c: char| c.is_alphanumeric() || c == '_';
    let inside = part.starts_with(word);
    name.match_indices(part).any(|(at, _)| !inside || !name[..at].ends_with(word))
}

/// Names of libgcc: `__`, verb, mode (half, single, double, quad), number of operands.
fn is_gnu_float(symbol: &str) -> bool {
    const VERBS: [&str; 13] =
        ["add", "sub", "mul", "div", "neg", "cmp", "eq", "ne", "lt", "le", "gt", "ge", "unord"];
    let modes = ["hf", "sf", "df", "tf"];
    let Some(name) = symbol.strip_prefix("__") else { return false };
    let Some(name) = name.strip_suffix(['2', '3']) else { return false };
    modes.iter().any(|mode| name.strip_suffix(mode).is_some_and(|verb| VERBS.contains(&verb)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forbidden_names_have_their_family() {
        let panics = [
            "_ZN4core9panicking5panic17h0123456789abcdefE",
            "_ZN4core9panicking18panic_bounds_check17h0123456789abcdefE",
            "_ZN4core6option13unwrap_failed17h0123456789abcdefE",
            "_ZN4core6result13unwrap_failed17h0123456789abcdefE",
            "_ZN4core5slice5index16slice_index_fail17h0123456789abcdefE",
            "_RNvNtCs1234_4core9panicking9panic_fmt",
            "_RNvCsdBezzDwma51_7___rustc17rust_begin_unwind",
            "rust_begin_unwind",
        ];
        let floats = [
            "__aeabi_fadd",
            "__aeabi_dmul",
            "__aeabi_i2f",
            "__aeabi_ul2d",
            "__aeabi_f2iz",
            "__aeabi_d2f",
            "__aeabi_cfcmple",
            "__aeabi_h2f",
            "__addsf3",
            "__muldf3",
            "__fixunsdfsi",
            "__floatsisf",
            "__unordsf2",
            "__truncdfsf2",
            "_ZN17compiler_builtins5float3add17h0123456789abcdefE",
        ];
        let heaps = [
            "__rust_alloc",
            "__rust_dealloc",
            "_RNvCsdBezzDwma51_7___rustc12___rust_alloc",
            "malloc",
            "free",
            "_ZN5alloc7raw_vec17capacity_overflow17h0123456789abcdefE",
            "__rdl_alloc",
        ];
        for (names, expected) in
            [(&panics[..], Family::Panic), (&floats[..], Family::Float), (&heaps[..], Family::Heap)]
        {
            for name in names {
                assert_eq!(family(name), Some(expected), "{name} ({})", plain(name));
            }
        }
    }

    #[test]
    fn needed_names_are_allowed() {
        for name in [
            "__aeabi_memcpy",
            "__aeabi_memclr4",
            "__aeabi_uldivmod",
            "__aeabi_ldivmod",
            "__aeabi_llsl",
            "__aeabi_idiv",
            "__udivmoddi4",
            "__muldi3",
            "__divdi3",
            "__negdi2",
            "__cmpdi2",
            "memcpy",
            "Reset",
            "main",
            "_ZN8tater_fw3bsp4stop4stop17h186901aec2e2d4e6E",
            "_ZN17compiler_builtins3int19specialized_div_rem11u64_div_rem17h0123456789abcdefE",
            "_ZN8tater_fw9not_alloc1f17h0123456789abcdefE",
        ] {
            assert_eq!(family(name), None, "{name} ({})", plain(name));
        }
    }
}
