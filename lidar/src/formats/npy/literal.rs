//! The Python literals of NPY headers: strings, whole numbers, True, False, None, tuples, lists, dictionaries.

use super::FormatError;

/// `NumPy` nests four deep: dictionary, list of fields, field, its shape.
const MAX_DEPTH: usize = 8;

/// A literal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Literal {
    Text(String),
    Whole(u128),
    Bool(bool),
    None,
    /// A tuple or a list.
    Sequence(Vec<Literal>),
    Dict(Vec<(Literal, Literal)>),
}

/// Reads one literal and nothing behind it but white space. `offset` is where `text` starts in the file.
pub(super) fn parse(text: &str, offset: usize) -> Result<Literal, FormatError> {
    let mut parser = Parser { text, position: 0, offset };
    let literal = parser.literal(0)?;
    match parser.peek() {
        None => Ok(literal),
        Some(_) => Err(parser.unexpected("the end of the header")),
    }
}

struct Parser<'a> {
    text: &'a str,
    position: usize,
    offset: usize,
}

impl Parser<'_> {
    fn literal(&mut self, depth: usize) -> Result<Literal, FormatError> {
        if depth > MAX_DEPTH {
            return Err(self.unexpected("less nesting"));
        }
        match self.peek() {
            Some(quote @ ('\'' | '"')) => self.string(quote),
            Some('(') => self.sequence(depth, ')'),
            Some('[') => self.sequence(depth, ']'),
            Some('{') => self.dict(depth),
            Some('0'..='9') => Ok(self.whole()),
            Some(_) => self.word(),
            None => Err(self.unexpected("a Python literal")),
        }
    }

    fn sequence(&mut self, depth: usize, close: char) -> Result<Literal, FormatError> {
        self.bump();
        let mut items = Vec::new();
        while !self.eat(close) {
            items.push(self.literal(depth + 1)?);
            if !self.eat(',') && self.peek() != Some(close) {
                return Err(self.unexpected("a comma or the end of the sequence"));
            }
        }
        Ok(Literal::Sequence(items))
    }

    fn dict(&mut self, depth: usize) -> Result<Literal, FormatError> {
        self.bump();
        let mut entries = Vec::new();
        while !self.eat('}') {
            let key = self.literal(depth + 1)?;
            if !self.eat(':') {
                return Err(self.unexpected("a colon"));
            }
            entries.push((key, self.literal(depth + 1)?));
            if !self.eat(',') && self.peek() != Some('}') {
                return Err(self.unexpected("a comma or the end of the dictionary"));
            }
        }
        Ok(Literal::Dict(entries))
    }

    fn string(&mut self, quote: char) -> Result<Literal, FormatError> {
        self.bump();
        let rest = &self.text[self.position..];
        match rest.find([quote, '\\']) {
            Some(end) if rest[end..].starts_with(quote) => {
                self.position += end + quote.len_utf8();
                Ok(Literal::Text(rest[..end].into()))
            }
            _ => Err(self.unexpected("a string without escapes, and its end")),
        }
    }

    fn whole(&mut self) -> Literal {
        let rest = &self.text[self.position..];
        let end = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
        self.position += end;
        // Python 2 wrote `10L`.
        if rest[end..].starts_with('L') {
            self.bump();
        }
        Literal::Whole(rest[..end].parse().unwrap_or(u128::MAX))
    }

    fn word(&mut self) -> Result<Literal, FormatError> {
        for (word, literal) in [("True", Literal::Bool(true)), ("False", Literal::Bool(false)), ("None", Literal::None)]
        {
            if self.text[self.position..].starts_with(word) {
                self.position += word.len();
                return Ok(literal);
            }
        }
        Err(self.unexpected("a Python literal"))
    }

    /// The next character that is no white space.
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.position..];
        self.position += rest.len() - rest.trim_start().len();
        self.text[self.position..].chars().next()
    }

    fn bump(&mut self) {
        self.position += self.text[self.position..].chars().next().map_or(0, char::len_utf8);
    }

    fn eat(&mut self, wanted: char) -> bool {
        let found = self.peek() == Some(wanted);
        if found {
            self.bump();
        }
        found
    }

    fn unexpected(&self, expected: &str) -> FormatError {
        let found: String = self.text[self.position..].chars().take(20).collect();
        FormatError::field("NPY header", self.offset + self.position, expected, found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_numpy_header_is_a_literal() -> Result<(), FormatError> {
        let literal =
            parse("{'descr': [('x', '<f4', (3,)), ('', '|V4')], 'fortran_order': False, 'shape': (2,), }  \n", 0)?;
        let Literal::Dict(entries) = literal else { return Err(FormatError::unsupported("no dictionary")) };
        assert_eq!(entries.len(), 3);
        assert_eq!(entries[2].1, Literal::Sequence(vec![Literal::Whole(2)]));
        Ok(())
    }

    #[test]
    fn nonsense_is_an_error_and_deep_nonsense_too() {
        for text in ["", "{", "(1", "(1 2)", "'a", "'\\x41'", "{'a' 1}", "{'a': 1} x", "é", &"[".repeat(60_000), "-1"]
        {
            assert!(parse(text, 0).is_err(), "{}", &text[..text.len().min(10)]);
        }
    }
}
