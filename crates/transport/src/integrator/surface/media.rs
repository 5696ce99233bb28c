//! The media that bodies bound, and the stacks of those around a point.

use std::collections::HashMap;

use glam::Vec3;

use crate::bsdf::Surface;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Absorption coefficient, linear RGB per metre.
    pub absorption: Vec3,
    pub ior: f32,
}

/// The media of a scene. A *stack* of those around a point is packed into 32 bits: a ray that enters a body pushes its medium, one
/// that leaves it removes that medium wherever it is, and the last one that was entered, in the lowest bits, is the medium at the
/// point. An empty stack, 0, is air.
///
/// It holds eight media in a scene of up to 15 different ones, four of up to 255, two of up to 65,535, else one. Those entered first
/// are forgotten where there are more.
#[derive(Debug, Clone)]
pub struct Media {
    /// The first one is air.
    table: Vec<Medium>,
    /// Of one medium of a stack.
    bits: u32,
}

impl Media {
    /// The different ones of these media and air, and the number of each in a stack.
    pub fn new(media: impl Iterator<Item = Option<Medium>>) -> (Self, Vec<Option<u32>>) {
        let mut table = vec![Medium { absorption: Vec3::ZERO, ior: 1.0 }];
        let mut known = HashMap::new();
        let mut number = |medium: Medium| {
            let bits = (medium.absorption.to_array().map(f32::to_bits), medium.ior.to_bits());
            *known.entry(bits).or_insert_with(|| {
                table.push(medium);
                table.len() as u32 - 1
            })
        };
        let numbers = media.map(|medium| medium.map(&mut number)).collect();
        let bits = [4, 8, 16].into_iter().find(|bits| table.len() <= 1 << bits).unwrap_or(u32::BITS);
        (Self { table, bits }, numbers)
    }

    pub(crate) fn absorb(&self) -> bool {
        self.table.iter().any(|medium| medium.absorption.max_element() > 0.0)
    }

    /// The medium at a point with this stack.
    #[inline]
    pub fn at(&self, stack: u32) -> &Medium {
        &self.table[self.innermost(stack) as usize]
    }

    #[inline]
    fn innermost(&self, stack: u32) -> u32 {
        stack & (u32::MAX >> (u32::BITS - self.bits))
    }

    /// What the medium at a point leaves of light, linear RGB, over `distance` metres.
    #[inline]
    pub fn transmittance(&self, stack: u32, distance: f32) -> Vec3 {
        if stack == 0 { Vec3::ONE } else { transmittance(self.at(stack).absorption, distance) }
    }

    /// The stack of a ray that enters a body of `medium`.
    #[inline]
    fn entered(&self, stack: u32, medium: u32) -> u32 {
        stack.checked_shl(self.bits).unwrap_or(0) | medium
    }

    /// The stack of a ray that leaves a body of `medium`; the same if it was in none.
    #[inline]
    pub fn left(&self, stack: u32, medium: u32) -> u32 {
        let at = (0..u32::BITS).step_by(self.bits as usize).find(|at| self.innermost(stack >> at) == medium);
        let Some(at) = at else { return stack };
        let below = (1 << at) - 1;
        stack & below | stack.checked_shr(self.bits).unwrap_or(0) & !below
    }

    /// The stacks on the side of `wo` and beyond the boundary of `medium` that a ray hits. One that comes from within and was in no
    /// such body was in one nevertheless.
    #[inline]
    pub(crate) fn at_boundary(&self, medium: u32, back_facing: bool, stack: u32) -> [u32; 2] {
        let entered = self.entered(stack, medium);
        match self.left(stack, medium) {
            left if back_facing && left != stack => [stack, left],
            _ if back_facing => [entered, stack],
            _ => [stack, entered],
        }
    }

    /// A boundary of `medium` between these stacks, of which `surface` is relative to air, relative to the medium on the other side.
    pub fn relative(&self, surface: Surface, medium: u32, stacks: [u32; 2]) -> Surface {
        // A dispersive surface has the index of a colour channel.
        let index = |stack: u32| if self.innermost(stack) == medium { surface.ior } else { self.at(stack).ior };
        let [near, far] = stacks.map(index);
        // An index of 0 is infinite.
        match (near, far) {
            _ if near <= 0.0 || far <= 0.0 => surface,
            _ if far > near => Surface { ior: far / near, back_facing: false, ..surface },
            _ if far < near => Surface { ior: near / far, back_facing: true, ..surface },
            _ => Surface { ior: 1.0, ..surface },
        }
    }
}

/// Transmittance, linear RGB, over `distance` metres in a medium of absorption coefficient `absorption` per metre.
#[inline]
fn transmittance(absorption: Vec3, distance: f32) -> Vec3 {
    if distance.is_finite() { (absorption * -distance).exp() } else { Vec3::ONE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stacks_give_back_what_they_hold_and_forget_what_was_entered_first() {
        for (count, holds) in [(3, 8), (15, 8), (16, 4), (255, 4), (256, 2), (70_000, 1)] {
            let medium = |i: usize| Medium { absorption: Vec3::splat(i as f32), ior: 1.5 };
            let (media, numbers) = Media::new((0..count).map(|i| Some(medium(i))).chain([None, Some(medium(1))]));
            assert_eq!((numbers[count], numbers[count + 1], numbers[0]), (None, numbers[1], Some(1)));
            let number = |i: usize| numbers[i % count].unwrap();
            let mut stack = 0;
            for entered in 0..10 {
                stack = media.entered(stack, number(entered));
                assert_eq!(*media.at(stack), medium(entered % count));
            }
            for left in (0..10).rev() {
                let known = left + holds >= 10;
                let [near, far] = media.at_boundary(number(left), true, stack);
                assert!(known == (near == stack) && (far != stack) == known, "{count} {left} {near:x} {far:x}");
                stack = far;
            }
            assert_eq!(stack, 0);
        }
        let (media, _) = Media::new((0..4).map(|i| Some(Medium { absorption: Vec3::ZERO, ior: 1.0 + i as f32 })));
        let stack = [1, 2, 3, 2].into_iter().fold(0, |stack, medium| media.entered(stack, medium));
        assert_eq!([1, 2, 3, 4].map(|medium| media.left(stack, medium)), [0x232, 0x123, 0x122, 0x1232]);
    }
}
