//! The XML of a description, whose prefixes need not be declared.
//!
//! Extensions for simulators of a decade ago stand in elements such as `sensor:camera` without a declaration of the prefix, which is no
//! XML with namespaces. They say nothing of the dynamics, and other programs pass over them.

use roxmltree::{Document, Error};

/// Most prefixes that may be undeclared.
const MOST: usize = 64;

/// A text that can be parsed, of the same length, with the colons behind undeclared prefixes as `_`; and these prefixes.
pub(super) fn with_prefixes(text: &str) -> Result<(String, Vec<String>), Error> {
    let (mut mended, mut prefixes) = (text.to_owned(), Vec::new());
    loop {
        match Document::parse(&mended) {
            Err(Error::UnknownNamespace(prefix, place)) => {
                let before = mended.clone();
                mended = without_prefix(&mended, &prefix);
                // A name that is not found in the text comes from an entity.
                if prefixes.len() == MOST || mended == before {
                    return Err(Error::UnknownNamespace(prefix, place));
                }
                prefixes.push(prefix);
            }
            Err(error) => return Err(error),
            Ok(_) => return Ok((mended, prefixes)),
        }
    }
}

/// The text with `_` for the colon behind a prefix of elements and attributes.
fn without_prefix(text: &str, prefix: &str) -> String {
    let mut mended = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('<') {
        mended.push_str(&rest[..at]);
        rest = &rest[at..];
        let markup = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")]
            .into_iter()
            .find(|(begin, _)| rest.starts_with(begin));
        let end = match markup {
            Some((_, end)) => rest.find(end).map_or(rest.len(), |at| at + end.len()),
            None => tag_end(rest),
        };
        match markup {
            Some(_) => mended.push_str(&rest[..end]),
            None => push_tag(&mut mended, &rest[..end], prefix),
        }
        rest = &rest[end..];
    }
    mended + rest
}

/// Where a tag ends that begins the text: behind the first `>` outside of quotes.
fn tag_end(text: &str) -> usize {
    let mut quote = None;
    for (at, c) in text.char_indices() {
        match quote {
            Some(open) if c == open => quote = None,
            None if c == '"' || c == '\'' => quote = Some(c),
            None if c == '>' => return at + 1,
            _ => {}
        }
    }
    text.len()
}

fn push_tag(mended: &mut String, tag: &str, prefix: &str) {
    let (mut quote, mut begins) = (None, false);
    let mut skipped = 0;
    for (at, c) in tag.char_indices() {
        if at < skipped {
            continue;
        }
        let own = begins && quote.is_none() && tag[at..].strip_prefix(prefix).is_some_and(|rest| rest.starts_with(':'));
        if own {
            mended.push_str(prefix);
            mended.push('_');
            skipped = at + prefix.len() + 1;
            begins = false;
            continue;
        }
        match quote {
            Some(open) if c == open => quote = None,
            None if c == '"' || c == '\'' => quote = Some(c),
            _ => {}
        }
        begins = quote.is_none() && (c == '<' || c == '/' || c.is_whitespace());
        mended.push(c);
    }
}

#[cfg(test)]
mod tests {
    use super::with_prefixes;

    #[test]
    fn only_undeclared_prefixes_are_rewritten() {
        let text =
            "<!-- s:x --><r xmlns:k='k:k'><s:camera a='s:1' s:b = \"&lt;s:q>\"><k:x/>s:t &lt;s:u</s:camera><o:p/></r>";
        let (mended, prefixes) = with_prefixes(text).expect("XML but for the prefixes");
        assert_eq!(prefixes, ["s", "o"]);
        assert_eq!(
            mended,
            "<!-- s:x --><r xmlns:k='k:k'><s_camera a='s:1' s_b = \"&lt;s:q>\"><k:x/>s:t &lt;s:u</s_camera><o_p/></r>"
        );
    }

    #[test]
    fn what_is_no_xml_stays_a_fault() {
        for text in ["<r><s:a></r>", "<r s:a='1", "", "<r>"] {
            assert!(with_prefixes(text).is_err(), "{text}");
        }
        let many: String = (0..100).map(|index| format!("<p{index}:a/>")).collect();
        assert!(with_prefixes(&format!("<r>{many}</r>")).is_err());
    }
}
