//! Stands in until the real one is merged.
use hil_sim::rig::Rig;
/// Stands in.
#[derive(Clone, Debug, Default)]
pub struct FrontEnd;
impl FrontEnd {
    /// Stands in.
    pub fn new() -> Self {
        Self
    }
    /// Stands in.
    pub fn sample(&mut self, rig: &mut Rig) -> [u16; 18] {
        let _ = rig.analog();
        let mut a = [2048; 18];
        a[1] = 2700;
        a
    }
}
