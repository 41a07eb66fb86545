//! Addresses of the chip as pointers.

pub fn pointer<T>(address: u32) -> *mut T {
    // Every address of this chip has 32 bits.
    core::ptr::with_exposed_provenance_mut(usize::try_from(address).unwrap_or(0))
}
