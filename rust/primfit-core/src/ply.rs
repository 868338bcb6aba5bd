//! Rows of PLY elements, whose lists make them differ in length.

use crate::Error;
use crate::error::Room;

/// A type of number.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// Bytes that it takes.
    pub size: usize,
    /// Whether it is whole.
    pub is_whole: bool,
}

/// A property: one number, or a list with its length before it.
#[derive(Debug, Clone, Copy)]
pub struct Property {
    /// Type of the length of a list.
    pub length: Option<Kind>,
    /// Type of the number, or of those of the list.
    pub kind: Kind,
}

/// The single numbers of `n_rows` rows of bytes, row after row, as they are, and how many bytes the
/// rows take with their lists.
///
/// # Errors
/// [`Error::Short`] when the bytes end before the rows do, [`Error::List`] for a list whose length is
/// no whole number of at least 0, and [`Error::Memory`].
pub fn rows_of_bytes(
    bytes: &[u8],
    n_rows: usize,
    properties: &[Property],
    is_big_endian: bool,
) -> Result<(Vec<u8>, usize), Error> {
    let single =
        |property: &Property| if property.length.is_none() { property.kind.size } else { 0 };
    let width: usize = properties.iter().map(single).sum();
    let least: usize = properties.iter().map(|each| each.length.unwrap_or(each.kind).size).sum();
    check_rows(bytes.len(), n_rows, least)?;
    let mut kept = Vec::with_room(n_rows * width)?;
    let mut at = 0;
    for row in 0..if least > 0 { n_rows } else { 0 } {
        for property in properties {
            let short = Error::Short { n_rows: row, expected: n_rows };
            let first = property.length.unwrap_or(property.kind).size;
            let part = bytes.get(at..at + first).ok_or_else(|| short.clone())?;
            at += first;
            let Some(length) = property.length else {
                kept.extend_from_slice(part);
                continue;
            };
            let n = whole(part, length, is_big_endian).ok_or(Error::List { row })?;
            at = n.checked_mul(property.kind.size).and_then(|n| at.checked_add(n)).ok_or(short)?;
        }
    }
    if at > bytes.len() {
        return Err(Error::Short { n_rows: n_rows - 1, expected: n_rows });
    }
    Ok((kept, at))
}

/// The same of rows of words, whose numbers are read.
///
/// # Errors
/// Also [`Error::Word`], whose line is the number of the row.
pub fn rows_of_words(
    text: &[u8],
    n_rows: usize,
    properties: &[Property],
) -> Result<(Vec<f64>, usize), Error> {
    let width = properties.iter().filter(|property| property.length.is_none()).count();
    check_rows(text.len() + 1, n_rows, 2 * properties.len())?;
    let mut kept = Vec::with_room(n_rows * width)?;
    let mut rest = text;
    for row in 0..if properties.is_empty() { 0 } else { n_rows } {
        for (column, property) in properties.iter().enumerate() {
            let short = Error::Short { n_rows: row, expected: n_rows };
            let word = next_word(&mut rest).ok_or_else(|| short.clone())?;
            let number: Option<f64> =
                std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            let number = number.ok_or_else(|| Error::Word {
                line: row + 1,
                column: column + 1,
                word: String::from_utf8_lossy(word).chars().take(40).collect(),
            })?;
            if property.length.is_none() {
                kept.push(number);
                continue;
            }
            if number < 0.0 || number.fract() != 0.0 {
                return Err(Error::List { row });
            }
            for _ in 0..number as usize {
                next_word(&mut rest).ok_or_else(|| short.clone())?;
            }
        }
    }
    Ok((kept, text.len() - rest.len()))
}

/// Refuses more rows than the rest of a file can hold.
fn check_rows(n_bytes: usize, expected: usize, least: usize) -> Result<(), Error> {
    match n_bytes.checked_div(least) {
        Some(n_rows) if n_rows < expected => Err(Error::Short { n_rows, expected }),
        _ => Ok(()),
    }
}

fn whole(bytes: &[u8], kind: Kind, is_big_endian: bool) -> Option<usize> {
    if !kind.is_whole {
        return None;
    }
    let shift = |n: u32, byte: &u8| n << 8 | u32::from(*byte);
    let n =
        if is_big_endian { bytes.iter().fold(0, shift) } else { bytes.iter().rev().fold(0, shift) };
    Some(n as usize)
}

fn next_word<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let text = rest.trim_ascii_start();
    let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
    let word = &text[..end];
    *rest = &text[end..];
    (!word.is_empty()).then_some(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BYTE: Kind = Kind { size: 1, is_whole: true };
    const SHORT: Kind = Kind { size: 2, is_whole: true };
    const ONE: Property = Property { length: None, kind: SHORT };
    const LIST: Property = Property { length: Some(BYTE), kind: SHORT };

    #[test]
    fn lists_are_stepped_over() {
        let bytes = [1, 2, 1, 9, 9, 3, 4, 5, 6, 0, 7, 8];
        let found = rows_of_bytes(&bytes, 2, &[ONE, LIST, ONE], false);
        assert_eq!(found, Ok((vec![1, 2, 3, 4, 5, 6, 7, 8], 12)));
        let found = rows_of_words(b"\n7  1 99 8\n\n9\t0\r\n10 rest", 2, &[ONE, LIST, ONE]);
        assert_eq!(found, Ok((vec![7.0, 8.0, 9.0, 10.0], 19)));
    }

    #[test]
    fn more_than_there_is_is_refused_before_memory_is_taken() {
        let short = Error::Short { n_rows: 1, expected: usize::MAX };
        assert_eq!(rows_of_bytes(&[0; 3], usize::MAX, &[ONE], false), Err(short.clone()));
        assert_eq!(rows_of_words(b"1 2", usize::MAX, &[ONE, ONE]), Err(short));
        let short = Error::Short { n_rows: 0, expected: 1 };
        assert_eq!(rows_of_bytes(&[255, 0], 1, &[LIST], false), Err(short.clone()));
        assert_eq!(rows_of_words(b"1e9 2", 1, &[LIST]), Err(short));
        assert_eq!(rows_of_words(b"-1 2", 1, &[LIST]), Err(Error::List { row: 0 }));
    }
}
