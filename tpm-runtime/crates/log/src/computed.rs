//! Columns that are computed of others, behind those of a file.

use crate::assumption::Assumption;
use crate::columns::{ColumnName, Columns};
use crate::error::LogError;
use crate::expression::Expression;
use crate::names::Names;
use crate::options::ReadingSettings;
use crate::stamps::Resolution;
use crate::steps::Steps;

/// A selected column.
enum Field {
    /// One of the file, by its place among those that are read.
    Own(usize),
    /// One that is computed, with the place of its first column among those that are read.
    Computed { expression: usize, first: usize },
}

impl Field {
    fn is_computed(&self) -> bool {
        matches!(self, Field::Computed { .. })
    }
}

/// The columns of a file, and behind them those that settings compute of them; a computed column is called by its expression.
pub(super) struct Computed<'c> {
    inner: &'c mut dyn Columns,
    header: Vec<ColumnName>,
    /// Expressions with the columns of their names.
    expressions: Vec<(Expression, Vec<usize>)>,
    fields: Vec<Field>,
    read: Vec<f64>,
    stack: Vec<f64>,
    /// Lines of the rows so far, and what was read there for expressions; nothing where nothing is computed.
    lines: Vec<u64>,
    kept: Vec<Vec<f64>>,
}

impl<'c> Computed<'c> {
    /// The columns of the file at `path`, with those that the settings compute: a signal may be mapped to an expression where no column
    /// is called so.
    ///
    /// # Errors
    /// [`LogError`] for an expression with a name that is missing or ambiguous.
    pub(super) fn of(inner: &'c mut dyn Columns, path: &str, options: &ReadingSettings) -> Result<Self, LogError> {
        let mut header = inner.header().to_vec();
        let mut expressions = Vec::new();
        for (signal, wanted) in &options.map {
            let names = Names::of(&*inner, path, options);
            // A column of that name comes first, even where several may be meant.
            if !matches!(names.find(wanted, signal, None), Ok(None)) {
                continue;
            }
            let Some(expression) = Expression::parse(wanted) else { continue };
            let column = |name: &String| -> Result<Option<usize>, LogError> {
                Ok(names.find(name, name, None)?.map(|found| found.index))
            };
            let columns: Vec<Option<usize>> = expression.names.iter().map(column).collect::<Result<_, LogError>>()?;
            // Of a text without any column it is not known that an expression is meant.
            if columns.iter().all(Option::is_none) {
                continue;
            }
            let places = columns.into_iter().zip(&expression.names);
            let columns = places.map(|(column, name)| column.ok_or_else(|| names.missing_in(signal, name, Vec::new())));
            let columns = columns.collect::<Result<_, LogError>>()?;
            header.push(ColumnName { computed: true, ..ColumnName::new(wanted) });
            expressions.push((expression, columns));
        }
        Ok(Computed {
            inner,
            header,
            expressions,
            fields: Vec::new(),
            read: Vec::new(),
            stack: Vec::new(),
            lines: Vec::new(),
            kept: Vec::new(),
        })
    }

    /// The steps of the numbers of every selected column that is computed, with the lines of the rows that were read.
    pub(super) fn steps(&mut self) -> Vec<Option<Vec<(u64, f64)>>> {
        let steps: Vec<Steps> = self.kept.iter().map(|column| Steps::of(column)).collect();
        let mut of_rows = Vec::new();
        for field in &self.fields {
            let Field::Computed { expression, first } = field else {
                of_rows.push(None);
                continue;
            };
            let expression = &self.expressions[*expression].0;
            let places = *first..*first + expression.names.len();
            let (mut numbers, mut own) = (vec![0.0; places.len()], vec![0.0; places.len()]);
            let mut of_field: Vec<(u64, f64)> = Vec::with_capacity(self.lines.len());
            for (row, line) in self.lines.iter().enumerate() {
                for (i, place) in places.clone().enumerate() {
                    numbers[i] = self.kept[place][row];
                    own[i] = steps[place].at(numbers[i]);
                }
                of_field.push((*line, expression.step(&mut numbers, &own, &mut self.stack)));
            }
            of_field.sort_by_key(|(line, _)| *line);
            of_rows.push(Some(of_field));
        }
        of_rows
    }
}

impl Columns for Computed<'_> {
    fn header(&self) -> &[ColumnName] {
        &self.header
    }

    fn header_line(&self) -> u64 {
        self.inner.header_line()
    }

    fn kind(&self) -> String {
        self.inner.kind()
    }

    fn units_line(&self) -> u64 {
        self.inner.units_line()
    }

    fn select(&mut self, wanted: &[usize]) {
        let own = self.header.len() - self.expressions.len();
        let mut read = Vec::new();
        self.fields.clear();
        for &column in wanted {
            let first = read.len();
            self.fields.push(match column.checked_sub(own) {
                None => {
                    read.push(column);
                    Field::Own(first)
                }
                Some(expression) => {
                    read.extend(&self.expressions[expression].1);
                    Field::Computed { expression, first }
                }
            });
        }
        self.inner.select(&read);
        self.read = vec![0.0; read.len()];
        self.kept = vec![Vec::new(); if self.fields.iter().any(Field::is_computed) { read.len() } else { 0 }];
    }

    fn next_row(&mut self, values: &mut [f64]) -> Result<Option<u64>, LogError> {
        let Some(line) = self.inner.next_row(&mut self.read)? else { return Ok(None) };
        if !self.kept.is_empty() {
            self.lines.push(line);
            self.kept.iter_mut().zip(&self.read).for_each(|(kept, number)| kept.push(*number));
        }
        for (value, field) in values.iter_mut().zip(&self.fields) {
            *value = match field {
                Field::Own(at) => self.read[*at],
                Field::Computed { expression, first } => {
                    let (expression, columns) = &self.expressions[*expression];
                    expression.evaluate(&self.read[*first..first + columns.len()], &mut self.stack)
                }
            };
        }
        Ok(Some(line))
    }

    fn text(&self, field: usize) -> String {
        match self.fields[field] {
            Field::Own(at) => self.inner.text(at),
            Field::Computed { expression, first } => {
                let mut read = first..first + self.expressions[expression].1.len();
                let missing = read.find(|at| !self.read[*at].is_finite());
                missing.map_or_else(|| "no finite number".to_owned(), |at| self.inner.text(at))
            }
        }
    }

    fn dated(&self) -> bool {
        self.inner.dated()
    }

    fn resolution(&self) -> Resolution {
        self.inner.resolution()
    }

    fn assumptions(&self) -> Vec<Assumption> {
        self.inner.assumptions()
    }
}

#[cfg(test)]
mod tests {
    use crate::{Log, LogError, ReadingSettings};
    use tpm_test_support::models::MassSpringDrag;

    /// A log whose input is not recorded, read with a setting for it.
    fn read(header: &str, input: &str) -> Result<Log, LogError> {
        let row = |k: i32| format!("{:.3},{},{},{}\n", f64::from(k) * 1e-3, (f64::from(k)).sin(), 3 * k, k % 5);
        let text = format!("{header}\n{}", (0..40).map(row).collect::<String>());
        let mut options = ReadingSettings::default();
        options.map.insert("u".into(), input.into());
        options.scale.insert("u".into(), 2.0);
        Log::read(text.as_bytes(), "run.csv", &MassSpringDrag, &options)
    }

    #[test]
    fn a_signal_is_computed_of_columns() {
        let expected: Vec<f64> = (0..40).map(|k| 2.0 * 0.5 * f64::from(3 * k - k % 5)).collect();
        for (header, input) in [
            ("t_s,x,pwm1,pwm2", "0.5*(pwm1-pwm2)"),
            ("t_s,x,pwm1 [V],PWM (two)", "0.5*(pwm1-\"PWM (two)\")"),
            ("t_s,x,a-b,/x/duty", "(`a-b` - `/x/duty`)/2"),
        ] {
            let log = read(header, input).unwrap_or_else(|error| panic!("{input}: {error}"));
            assert_eq!(log.channels[1], expected, "{input}");
        }
        // A column of that very name comes first.
        let log = read("t_s,x,pwm1-pwm2,pwm2", "pwm1-pwm2").expect("a column");
        assert_eq!(log.channels[1][2], 12.0);
    }

    #[test]
    fn names_that_are_missing_are_named() {
        let message = read("t_s,x,pwm1,pwm2", "0.5*(pwm1-pwm3)").expect_err("no such column").to_string();
        assert!(message.starts_with("run.csv:1: there is no column `pwm3` for `u`"), "{message}");
        assert!(message.contains("the columns are t_s, x, pwm1, pwm2; name"), "{message}");
        let message = read("t_s,x,pwm1,pwm2", "left-right").expect_err("no such column").to_string();
        assert!(message.contains("no column `left-right` for `u`"), "{message}");
        // What is infinite is a reading that is missing.
        let message = read("t_s,x,pwm1,pwm2", "1/pwm2").expect_err("a division by zero").to_string();
        assert!(message.starts_with("run.csv:2: column `1/pwm2` holds `no finite number`"), "{message}");
    }
}
