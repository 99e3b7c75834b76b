//! Buffers for lists of numerators, reused between products.

use crate::number::numerator::Numerator;
use crate::number::values::{Values, for_width};
use crate::number::wide::Wide;
use num_bigint::BigInt;
use smallvec::SmallVec;
use std::any::Any;

/// A numerator whose list buffers are stored in [`Rooms`].
pub(crate) trait Buffered: Numerator {
    /// The buffers of this width.
    fn room(rooms: &mut Rooms) -> &mut Room<Self>;
}

/// Buffers of one width, reused between products.
#[derive(Debug)]
pub(crate) struct Room<T> {
    spare: SmallVec<[Vec<T>; 2]>,
    /// A buffer for a list that is extended to both sides.
    pub(crate) padded: Vec<T>,
}

impl<T> Default for Room<T> {
    fn default() -> Self {
        Self { spare: SmallVec::new(), padded: Vec::new() }
    }
}

impl<T> Room<T> {
    /// An empty list with the capacity `len`.
    pub(crate) fn take(&mut self, len: usize) -> Vec<T> {
        // Later products are longer, so a larger capacity than needed now saves an allocation.
        let Some(mut list) = self.spare.pop() else { return Vec::with_capacity(len.max(16)) };
        list.clear();
        list
    }
}

/// Buffers of every width: allocating memory would cost more than a small product.
#[derive(Debug, Default)]
pub(crate) struct Rooms {
    one: Room<i64>,
    two: Room<i128>,
    /// The buffers for numbers of more than two words, which most tables never need.
    wide: Option<Box<WideRooms>>,
}

#[derive(Debug, Default)]
struct WideRooms {
    three: Room<Wide<3>>,
    four: Room<Wide<4>>,
    six: Room<Wide<6>>,
    eight: Room<Wide<8>>,
    big: Room<BigInt>,
}

impl Rooms {
    /// Stores the buffer of values that are no longer needed.
    pub(crate) fn recycle(&mut self, values: Values) {
        fn give<T: Buffered>(rooms: &mut Rooms, list: Vec<T>) {
            if list.capacity() > 0 {
                T::room(rooms).spare.push(list);
            }
        }
        for_width!(values, list => give(self, list));
    }
}

impl Buffered for i64 {
    fn room(rooms: &mut Rooms) -> &mut Room<Self> {
        &mut rooms.one
    }
}

impl Buffered for i128 {
    fn room(rooms: &mut Rooms) -> &mut Room<Self> {
        &mut rooms.two
    }
}

impl<const N: usize> Buffered for Wide<N> {
    fn room(rooms: &mut Rooms) -> &mut Room<Self> {
        let rooms = rooms.wide.get_or_insert_default();
        let room: &mut dyn Any = match N {
            3 => &mut rooms.three,
            4 => &mut rooms.four,
            6 => &mut rooms.six,
            _ => &mut rooms.eight,
        };
        room.downcast_mut().expect("invariant: the widths of `Values` are those of `Rooms`")
    }
}

impl Buffered for BigInt {
    fn room(rooms: &mut Rooms) -> &mut Room<Self> {
        &mut rooms.wide.get_or_insert_default().big
    }
}
