//! The secret that a listener asks for.

use std::fmt;

use sha2::{Digest, Sha256};
use thiserror::Error;

/// Characters that a token may have.
const LENGTHS: std::ops::RangeInclusive<usize> = 16..=4096;

/// A bearer token, kept as its SHA-256 alone, and never shown.
#[derive(Clone)]
pub struct Token([u8; 32]);

/// A text that is no token.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("expected a token of {} to {} visible ASCII characters", LENGTHS.start(), LENGTHS.end())]
pub struct TokenError;

impl Token {
    /// Takes a token over; white space around it, such as a file's last line break, is none of it.
    pub fn new(text: &str) -> Result<Self, TokenError> {
        let text = text.trim();
        let good = LENGTHS.contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_graphic());
        if good { Ok(Self(Sha256::digest(text).into())) } else { Err(TokenError) }
    }

    /// True if the offered text is this token. The time that this takes tells nothing about how much of it is right: digests are compared,
    /// and to their end.
    pub(crate) fn is(&self, offered: &str) -> bool {
        let offered: [u8; 32] = Sha256::digest(offered).into();
        self.0.iter().zip(offered).fold(0, |difference, (a, b)| difference | (a ^ b)) == 0
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_known_by_every_one_of_its_characters() -> Result<(), TokenError> {
        let token = Token::new("0123456789abcdef\n")?;
        assert!(token.is("0123456789abcdef"));
        for other in ["", "0123456789abcde", "0123456789abcdeg", "1123456789abcdef", "0123456789abcdef\n"] {
            assert!(!token.is(other), "{other}");
        }
        assert!(["", "short", "0123456789 abcdef"].iter().all(|text| Token::new(text).is_err()));
        assert_eq!(format!("{token:?}"), "Token");
        Ok(())
    }
}
