//! A list of the fields of a file, read from its JSON schema.

use serde_json::Value;

/// Placeholder in a path for a name that the user chooses, such as that of a coordinate.
const NAME_PLACEHOLDER: &str = "NAME";
/// Deepest nesting of fields that is followed.
const MOST_DEPTH: usize = 8;

/// One field of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldText {
    /// Path in the file, such as `plant.sensors.NAME.noise`; `NAME` is a name that the user chooses.
    pub path: String,
    /// Kind of the value, such as `number` or `list of tables`.
    pub kind: String,
    /// Meaning, from the schema's description.
    pub meaning: String,
    /// Whether the table around the field must contain it.
    pub required: bool,
    /// Value that applies where the field is absent; nothing where the default is no single value.
    pub default: Option<String>,
    /// Permitted words, each with its meaning; empty where the value is no word.
    pub choices: Vec<(String, String)>,
}

/// All fields of a schema, in its order.
#[must_use]
pub fn fields(schema: &Value) -> Vec<FieldText> {
    let mut found = Vec::new();
    walk(schema, schema, "", MOST_DEPTH, &mut found);
    found
}

/// The schema that a `$ref` names; of an optional value, `anyOf` a schema and null, that schema.
fn resolved<'a>(root: &'a Value, mut own: &'a Value) -> &'a Value {
    for _ in 0..MOST_DEPTH {
        let reference = own["$ref"].as_str().and_then(|reference| reference.strip_prefix("#/$defs/"));
        let alone = own["anyOf"].as_array().and_then(|list| {
            let mut others = list.iter().filter(|part| part["type"] != "null");
            others.next().filter(|_| others.next().is_none())
        });
        own = match (reference, alone) {
            (Some(name), _) => &root["$defs"][name],
            (None, Some(part)) => part,
            (None, None) => return own,
        };
    }
    own
}

fn walk(root: &Value, table: &Value, path: &str, depth: usize, found: &mut Vec<FieldText>) {
    let Some(properties) = table["properties"].as_object().filter(|_| depth > 0) else { return };
    for (name, own) in properties {
        let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        let target = resolved(root, own);
        let required = table["required"].as_array().is_some_and(|list| list.iter().any(|other| other == name));
        let default = match &own["default"] {
            Value::Null | Value::Object(_) | Value::Array(_) => None,
            value => Some(value.to_string()),
        };
        let said = own["description"].as_str().or_else(|| target["description"].as_str());
        let meaning = said.unwrap_or_default().replace('\n', " ").replace("[`", "`").replace("`]", "`");
        found.push(FieldText {
            path: path.clone(),
            kind: kind(root, target),
            meaning,
            required,
            default,
            choices: choices(target),
        });
        inner(root, target, &path, depth - 1, found);
    }
}

/// Appends the fields inside a field: those of a table, of the entries of a list, and of tables by name.
fn inner(root: &Value, own: &Value, path: &str, depth: usize, found: &mut Vec<FieldText>) {
    walk(root, own, path, depth, found);
    if own["items"].is_object() {
        walk(root, resolved(root, &own["items"]), path, depth, found);
    }
    if own["additionalProperties"].is_object() && own["properties"].is_null() {
        walk(root, resolved(root, &own["additionalProperties"]), &format!("{path}.{NAME_PLACEHOLDER}"), depth, found);
    }
}

fn kind(root: &Value, own: &Value) -> String {
    if !choices(own).is_empty() {
        return "word".to_owned();
    }
    let named = match &own["type"] {
        Value::String(name) => Some(name.as_str()),
        Value::Array(names) => names.iter().filter_map(Value::as_str).find(|name| *name != "null"),
        _ => None,
    };
    match named {
        Some("object") if own["additionalProperties"].is_object() && own["properties"].is_null() => {
            format!("{} by name", kind(root, resolved(root, &own["additionalProperties"])))
        }
        Some("object") => "table".to_owned(),
        Some("array") => format!("list of {}s", kind(root, resolved(root, &own["items"]))),
        Some("string") => "text".to_owned(),
        Some("integer") => "whole number".to_owned(),
        Some("boolean") => "true or false".to_owned(),
        Some(other) => other.to_owned(),
        None => "value".to_owned(),
    }
}

/// The permitted words of a field, with their meaning.
fn choices(own: &Value) -> Vec<(String, String)> {
    let list = own["oneOf"].as_array().map_or(&[][..], Vec::as_slice);
    let word = |part: &Value| {
        let meaning = part["description"].as_str().unwrap_or_default().replace('\n', " ");
        Some((part["const"].as_str()?.to_owned(), meaning))
    };
    list.iter().filter_map(word).collect()
}
