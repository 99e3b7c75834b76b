//! Where the rows of a regressor jump along a motion, or bend as sharply as a jump: with the sign of a velocity, or a function that saturates.

use num_traits::One;
use std::collections::BTreeSet;
use tpm_symbolic::expr::graph::Function;
use tpm_symbolic::number::rational::Rational;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::straight_line::{Merger, Plan};

/// The jumps of a regressor.
#[derive(Clone, Debug)]
pub(super) struct Jumps {
    /// The arguments of the functions that jump, rows times `count`; 1 where a row has fewer.
    pub(super) arguments: Plan,
    /// The most arguments of a row.
    pub(super) count: usize,
    /// Whether each entry of the regressor, rows times columns, depends on such a function.
    pub(super) entries: Vec<bool>,
}

impl Jumps {
    /// Those of a regressor with so many columns, and of `known`, the terms without an unknown parameter; nothing where no row jumps.
    pub(super) fn of(regressor: &Plan, columns: usize, known: &Plan) -> Option<Self> {
        let mut merger = Merger::default();
        let entries = merger.append(regressor);
        let known = merger.append(known);
        let outputs = entries.chunks(columns).zip(known).flat_map(|(row, known)| row.iter().copied().chain([known]));
        let all = merger.finish(outputs.collect());
        let mut moves: Vec<bool> = Vec::with_capacity(all.ops.len());
        // The arguments on which every operation depends.
        let mut behind: Vec<BTreeSet<Slot>> = Vec::with_capacity(all.ops.len());
        for op in &all.ops {
            moves.push(match op {
                Op::Load(index) => matches!(all.inputs[*index as usize], Leaf::Motion(..)),
                op => op.operands().any(|slot| moves[slot.index()]),
            });
            let mut own: BTreeSet<Slot> = op.operands().flat_map(|slot| behind[slot.index()].clone()).collect();
            if let Op::Function(Function::Sign | Function::Tanh | Function::Atan, argument) = op
                && moves[argument.index()]
            {
                own.insert(*argument);
            }
            behind.push(own);
        }
        let rows: Vec<&[Slot]> = all.outputs.chunks(columns + 1).collect();
        let of_row =
            |row: &&[Slot]| -> BTreeSet<Slot> { row.iter().flat_map(|slot| behind[slot.index()].clone()).collect() };
        let of_rows: Vec<Vec<Slot>> = rows.iter().map(|row| of_row(row).into_iter().collect()).collect();
        let count = of_rows.iter().map(Vec::len).max().filter(|count| *count > 0)?;
        let lengths: Vec<usize> = of_rows.iter().map(Vec::len).collect();
        let entries =
            rows.iter().flat_map(|row| &row[..columns]).map(|slot| !behind[slot.index()].is_empty()).collect();
        let mut merger = Merger::default();
        let mut found = merger.append(&Plan { outputs: of_rows.concat(), ..all.clone() }).into_iter();
        let one = merger.emit(Op::Constant(Rational::one()));
        let mut outputs = Vec::with_capacity(rows.len() * count);
        for length in lengths {
            outputs.extend(found.by_ref().take(length));
            outputs.resize(outputs.len() + count - length, one);
        }
        Some(Self { arguments: merger.finish(outputs), count, entries })
    }
}
