//! How many attributes the elements of an XML text have, before it is read: the reader compares every attribute with all others of its
//! element, and copies the namespaces around an element that declares one.

use crate::source::Span;

/// Most attributes of an element. Those of a URDF have six at most.
const MOST_ATTRIBUTES: usize = 100;
/// Most declarations of namespaces in a text.
const MOST_NAMESPACES: usize = 1000;

/// The first place at which there are too many attributes, with the number that is allowed there. Texts that are no XML may be counted
/// wrongly, and are refused by the reader.
pub(super) fn excess(text: &str) -> Option<(Span, usize)> {
    let mut rest = Scanner { text, at: 0 };
    let mut namespaces = 0;
    while rest.skip_to("<") {
        match rest.rest() {
            after if after.starts_with("<!--") => rest.skip_past("-->"),
            after if after.starts_with("<![CDATA[") => rest.skip_past("]]>"),
            after if after.starts_with("<?") => rest.skip_past("?>"),
            _ => {
                let start = rest.at;
                let (attributes, declared) = rest.tag();
                namespaces += declared;
                let place = || Span::new(start as u32, rest.at as u32);
                if attributes > MOST_ATTRIBUTES {
                    return Some((place(), MOST_ATTRIBUTES));
                }
                if namespaces > MOST_NAMESPACES {
                    return Some((place(), MOST_NAMESPACES));
                }
            }
        }
    }
    None
}

struct Scanner<'a> {
    text: &'a str,
    at: usize,
}

impl Scanner<'_> {
    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    /// Goes to the next place of a text; to the end where there is none.
    fn skip_to(&mut self, what: &str) -> bool {
        let found = self.rest().find(what);
        self.at += found.unwrap_or(self.rest().len());
        found.is_some()
    }

    fn skip_past(&mut self, what: &str) {
        if self.skip_to(what) {
            self.at += what.len();
        }
    }

    /// Goes to the end of a tag, or to the attribute that is one too many; the numbers of its attributes and of the namespaces among them.
    fn tag(&mut self) -> (usize, usize) {
        let (mut attributes, mut namespaces, mut quote) = (0, 0, None);
        let bytes = self.text.as_bytes();
        while self.at < bytes.len() && attributes <= MOST_ATTRIBUTES {
            let byte = bytes[self.at];
            match (quote, byte) {
                (Some(open), _) if byte == open => quote = None,
                (Some(_), _) => {}
                (None, b'"' | b'\'') => quote = Some(byte),
                (None, b'=') => attributes += 1,
                (None, b'>') => break,
                (None, b'x') if self.text.as_bytes()[self.at..].starts_with(b"xmlns") => namespaces += 1,
                (None, _) => {}
            }
            self.at += 1;
        }
        // A character of several bytes is no end of a tag.
        while !self.text.is_char_boundary(self.at) {
            self.at += 1;
        }
        (attributes, namespaces)
    }
}

#[cfg(test)]
mod tests {
    use super::excess;

    #[test]
    fn attributes_are_counted_where_they_are_attributes() {
        let many = |count: usize| (0..count).map(|i| format!(" a{i}='é=\">'")).collect::<String>();
        assert_eq!(excess(&format!("<robot{}/>", many(100))), None);
        let (place, most) = excess(&format!("<?x?><robot><link{}/></robot>", many(101))).expect("too many");
        assert_eq!((place.start, most), (12, 100));
        // Comments, texts and values have no attributes.
        let quiet = "=".repeat(1000);
        assert_eq!(excess(&format!("<!-- {quiet} --><r a='{quiet}'>{quiet}<![CDATA[<{quiet}]]></r>")), None);
        let spaces = "<a xmlns:b='c'>".repeat(1001);
        assert_eq!(excess(&spaces).map(|(_, most)| most), Some(1000));
        for text in ["", "<", "<é", "<!-- ", "<a b=", "<a é='", "no tag"] {
            assert_eq!(excess(text), None);
        }
    }
}
