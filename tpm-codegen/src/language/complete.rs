//! Forces that a model lacks, written into its text: the author's statements and comments stay as they are.
//!
//! A force is a parameter times an expression. With equations it is added to those of its rows, on the side of the model's own forces; with a
//! mechanism or energies it is a part of the force on its coordinate.

use crate::diagnostic::Diagnostics;
use crate::language::ast::mechanism::InertiaDeclaration;
use crate::language::ast::{Equation, Item, ModelDeclaration, Role};
use crate::language::{end_of_statements, format, parse};
use crate::source::{Source, Span};
use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fmt;
use tpm_symbolic::mechanics::tree::mechanism::Loss;

/// A force that is added to a model.
#[derive(Clone, Debug, PartialEq)]
pub struct AddedForce {
    /// Name of its parameter; a number is put behind it where the model has that name.
    pub parameter: String,
    /// Unit of the parameter; nothing where it is not checked.
    pub unit: Option<String>,
    /// What it is, for the comment beside its parameter.
    pub meaning: String,
    /// Known numbers in it: name, value, unit. The expressions have the names in braces.
    pub constants: Vec<(String, f64, Option<String>)>,
    /// Friction that builds up in it: what its state is called, the coordinate that reverses, and the travel.
    pub presliding: Option<(String, String, f64)>,
    /// What the parameter is multiplied by in every row in which the force acts: the row, its coordinate, and the expression.
    pub rows: Vec<(usize, String, String)>,
}

/// Travels that differ by less than this factor are those of one friction.
const ONE_TRAVEL: f64 = 2.0;

impl AddedForce {
    /// Whether another force is this one, as another log shows it: numbers in it may differ.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        let travels = self.presliding.as_ref().zip(other.presliding.as_ref());
        self.rows == other.rows
            && travels.is_none_or(|(own, other)| (1.0 / ONE_TRAVEL..ONE_TRAVEL).contains(&(own.2 / other.2)))
    }
}

/// Dry friction of drives in proportion to their load.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AddedLoads {
    /// The drives, by their coordinates.
    pub drives: Vec<String>,
    /// The ten parameters of the inertia of every body with which the load is computed.
    pub near: Vec<(String, Vec<f64>)>,
}

/// Why forces cannot be written into a text.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum CannotAdd {
    /// The text has faults.
    Text(Diagnostics),
    /// The rows of the model are not those of its text.
    Eliminated,
    /// The text has no such row.
    NoRow(usize),
}

impl fmt::Display for CannotAdd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(faults) => faults.fmt(f),
            Self::Eliminated => f.write_str(
                "coordinates of the model are eliminated, so that what it lacks is no force of one of its equations; write it into the \
                 equations by hand",
            ),
            Self::NoRow(row) => write!(f, "the model has no equation {}", row + 1),
        }
    }
}

impl Error for CannotAdd {}

/// The text of a model with forces that it lacks, formatted.
///
/// # Errors
/// [`CannotAdd`].
///
/// ```
/// use tpm_codegen::language::complete::{AddedForce, AddedLoads, with_forces};
/// use tpm_codegen::source::Source;
/// let text = "model Cart { coordinate x [m]; input u [N]; parameter m [kg]; m*ddot(x) = u; }";
/// let drag = AddedForce {
///     parameter: "drag_x".into(),
///     unit: Some("N*s^2/m^2".into()),
///     meaning: "drag".into(),
///     constants: Vec::new(),
///     presliding: None,
///     rows: vec![(0, "x".into(), "dot(x)*abs(dot(x))".into())],
/// };
/// let whole = with_forces(&Source::new("cart.tpm", text), &[drag], &AddedLoads::default()).expect("a model of one equation");
/// assert!(whole.contains("m*ddot(x) + drag_x*dot(x)*abs(dot(x)) = u;"));
/// ```
pub fn with_forces(source: &Source, forces: &[AddedForce], loads: &AddedLoads) -> Result<String, CannotAdd> {
    let model = parse(source).map_err(CannotAdd::Text)?;
    let items = || model.items.iter();
    if items().any(|item| matches!(item, Item::Eliminate(_))) {
        return Err(CannotAdd::Eliminated);
    }
    let equations: Vec<&Equation> =
        items().filter_map(|item| if let Item::Equation(equation) = item { Some(equation) } else { None }).collect();
    let by_coordinates = items().any(|item| matches!(item, Item::Mechanism(_) | Item::Energy(_)));
    let mut words: BTreeSet<String> = words(source.text()).map(String::from).collect();
    let mut fresh = |name: &str| {
        let mut numbered = (2..).map(|number| format!("{name}_{number}"));
        let own = if words.contains(name) { numbered.find(|own| !words.contains(own)) } else { None };
        let own = own.unwrap_or_else(|| name.to_owned());
        words.insert(own.clone());
        own
    };
    let unit = |unit: &Option<String>| unit.as_ref().map_or_else(String::new, |unit| format!(" [{unit}]"));
    let mut declared = String::new();
    // What is added to every row.
    let mut added: BTreeMap<usize, (&str, Vec<String>)> = BTreeMap::new();
    for force in forces {
        let name = fresh(&force.parameter);
        declared += &format!("    parameter {name}{}; // {}\n", unit(&force.unit), force.meaning);
        let mut names = Vec::with_capacity(force.constants.len());
        for (constant, value, own) in &force.constants {
            let own_name = fresh(constant);
            declared += &format!("    constant {own_name} = {:?}{};\n", rounded(*value), unit(own));
            names.push((format!("{{{constant}}}"), own_name));
        }
        if let Some((state, coordinate, travel)) = &force.presliding {
            let own_name = fresh(state);
            declared += &format!("    presliding {own_name} of {coordinate} over {:?};\n", rounded(*travel));
            names.push((format!("{{{state}}}"), own_name));
        }
        for (row, coordinate, expression) in &force.rows {
            let expression = names.iter().fold(expression.clone(), |text, (mark, name)| text.replace(mark, name));
            let (negative, expression) =
                expression.strip_prefix('-').map_or((false, expression.as_str()), |own| (true, own));
            // A force of its own stands on the other side of the equation.
            let sign = if negative == by_coordinates { '+' } else { '-' };
            let entry = added.entry(*row).or_insert((coordinate, Vec::new()));
            entry.1.push(format!(" {sign} {name}*{expression}"));
        }
    }
    let inputs: BTreeSet<&str> = (items())
        .filter_map(|item| if let Item::Declaration(own) = item { Some(own) } else { None })
        .filter(|own| own.role == Role::Input)
        .flat_map(|own| own.quantities.iter().map(|quantity| quantity.name.name.as_str()))
        .collect();
    let drives = |span: Span| self::words(source.slice(span)).any(|word| inputs.contains(word));
    let mut insertions: Vec<(usize, String)> = Vec::new();
    for (row, (coordinate, terms)) in &added {
        let terms = terms.concat();
        let own_force = items().find_map(|item| match item {
            Item::Force(force) if force.coordinate.name == *coordinate => Some(force.value.span),
            _ => None,
        });
        if !by_coordinates {
            let equation = equations.get(*row).ok_or(CannotAdd::NoRow(*row))?;
            let (left, right) = (equation.left.span, equation.right.span);
            let side = if drives(left) && !drives(right) { right } else { left };
            insertions.push((side.range().end, terms));
        } else if let Some(span) = own_force {
            insertions.push((span.range().end, terms));
        } else {
            let first = terms.strip_prefix(" + ").map(str::to_owned);
            let first = first.unwrap_or_else(|| terms.replacen(" - ", "-", 1));
            declared += &format!("    force {coordinate} = {first};\n");
        }
    }
    if !declared.is_empty() {
        let place = place_of_statements(source, &model);
        insertions.push((place, format!("\n    // What the model lacked.\n{declared}\n    ")));
    }
    insertions.extend(of_loads(source, &model, loads));
    insertions.sort_by_key(|own| std::cmp::Reverse(own.0));
    let mut text = source.text().to_owned();
    insertions.iter().for_each(|(at, own)| text.insert_str(*at, own));
    format::format(&Source::new(source.name(), text)).map_err(CannotAdd::Text)
}

/// What is written into the drives and bodies of a mechanism for loads; values near which inertias are stay where there are any.
fn of_loads(source: &Source, model: &ModelDeclaration, loads: &AddedLoads) -> Vec<(usize, String)> {
    let mechanism = model.items.iter().find_map(|item| if let Item::Mechanism(own) = item { Some(own) } else { None });
    let Some(mechanism) = mechanism.filter(|_| !loads.drives.is_empty()) else { return Vec::new() };
    let mut insertions = Vec::new();
    for drive in mechanism.drives().filter(|drive| loads.drives.contains(&drive.name.name)) {
        let has = drive.losses.iter().any(|(loss, _)| *loss == Loss::Load);
        match (drive.losses.last(), &drive.input) {
            _ if has => {}
            (Some((_, last)), _) => insertions.push((last.span.range().end, ", load".to_owned())),
            (None, input) => {
                insertions.push((input.as_ref().unwrap_or(&drive.name).span.range().end, " with load".to_owned()));
            }
        }
    }
    for body in mechanism.bodies().filter(|body| body.near.is_none()) {
        let values = loads.near.iter().find(|(name, _)| *name == body.name.name);
        let (Some((_, values)), Some(InertiaDeclaration::Parameters(names))) = (values, &body.inertia) else {
            continue;
        };
        let begin = names.first().map_or(0, |name| name.span.range().start);
        let Some(at) = source.text()[begin..].find("parameters") else { continue };
        let values: Vec<String> = values.iter().map(|value| format!("{:?}", rounded(*value))).collect();
        insertions.push((begin + at + "parameters".len(), format!(" near ({})", values.join(", "))));
    }
    insertions
}

/// Where statements can be added: before the first pattern, or at the end of the model.
fn place_of_statements(source: &Source, model: &ModelDeclaration) -> usize {
    let pattern = model.items.iter().find_map(|item| match item {
        Item::Pattern(pattern) => Some(pattern.keyword.range().start),
        _ => None,
    });
    pattern.unwrap_or_else(|| end_of_statements(source))
}

/// A number with six digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

/// The words of a text, names among them.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|own: char| !own.is_alphanumeric() && own != '_').filter(|word| !word.is_empty())
}

#[cfg(test)]
mod tests {
    use super::{AddedForce, AddedLoads, CannotAdd, with_forces};
    use crate::language::parse_model;
    use crate::source::Source;

    fn force(parameter: &str, rows: &[(usize, &str, &str)]) -> AddedForce {
        AddedForce {
            parameter: parameter.into(),
            unit: Some("N".into()),
            meaning: "friction".into(),
            constants: vec![("vs".into(), 0.123_456_789, Some("m/s".into()))],
            presliding: None,
            rows: rows.iter().map(|(row, q, text)| (*row, (*q).into(), (*text).into())).collect(),
        }
    }

    fn completed(text: &str, forces: &[AddedForce]) -> String {
        let whole = with_forces(&Source::new("m.tpm", text), forces, &AddedLoads::default()).expect("a sound model");
        parse_model(&Source::new("m.tpm", whole.as_str())).unwrap_or_else(|faults| panic!("{faults}\n{whole}"));
        whole
    }

    #[test]
    fn forces_stand_beside_those_of_the_model_with_names_of_their_own() {
        let friction = "sign(dot(x))*exp(-(dot(x)/{vs})^2)";
        let text =
            "model M { coordinate x [m]; input u [N]; parameter m [kg], fs [N]; u = m*ddot(x) + fs*sign(dot(x)); }";
        let whole = completed(text, &[force("fs", &[(0, "x", friction)]), force("fs", &[(0, "x", "sign(x)")])]);
        let own = "u = m*ddot(x) + fs*sign(dot(x)) + fs_2*sign(dot(x))*exp(-(dot(x)/vs)^2) + fs_3*sign(x);";
        assert!(whole.contains(own) && whole.contains("constant vs = 0.123457 [m/s];"), "{whole}");
    }

    #[test]
    fn forces_between_coordinates_of_energies_join_those_that_are_there() {
        let text = "model M {
            coordinate x [m], y [m]; input u [N]; parameter m [kg], n [kg];
            kinetic = 1/2*m*dot(x)^2 + 1/2*n*dot(y)^2;
            force x = u; // the motor
            pattern { amplitude a [m]; frequency w [rad/s]; x = a*cos(w*t); y = a*cos(w*t); }
        }";
        let between = force("fc", &[(0, "x", "sign(dot(x) - dot(y))"), (1, "y", "-sign(dot(x) - dot(y))")]);
        let whole = completed(text, &[between]);
        for own in ["force x = u - fc*sign(dot(x) - dot(y));", "// the motor", "force y = fc*sign(dot(x) - dot(y));"] {
            assert!(whole.contains(own), "{own}\n{whole}");
        }
    }

    #[test]
    fn rows_that_are_not_in_the_text_are_refused() {
        let text = "model M { coordinate x [m], y [m]; input u [N]; parameter m [kg], k [N/m];
            m*ddot(x) + k*(x - y) = u; m*ddot(y) + k*(y - x) = 0; eliminate x as c; }";
        let refused = |text: &str, row| {
            with_forces(&Source::new("m.tpm", text), &[force("f", &[(row, "x", "x")])], &AddedLoads::default())
        };
        assert_eq!(refused(text, 0), Err(CannotAdd::Eliminated));
        let one = "model M { coordinate x [m]; input u [N]; parameter m [kg]; m*ddot(x) = u; }";
        assert_eq!(refused(one, 1), Err(CannotAdd::NoRow(1)));
    }
}
