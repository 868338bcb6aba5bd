//! Tables of numbers as text, a row a line.

use crate::error::Room;
use crate::{Error, Workers};
use std::io::Write;
use std::str::FromStr;

/// Lines between two questions to the caller.
const LINES: usize = 1 << 14;
/// Most bytes of a number as text, and of what parts it from the next.
const WORD: usize = 25;

/// What spreadsheets write after "#" where a number is missing, which is no remark.
const SPOILT: [&[u8]; 7] = [b"N/A", b"DIV/0!", b"NUM!", b"VALUE!", b"REF!", b"NAME?", b"NULL!"];

/// Where the numbers of a line are.
pub struct Lines<'a> {
    /// What parts the columns; None is any white space.
    pub separator: Option<u8>,
    /// How many columns every line has.
    pub n_columns: usize,
    /// The columns to read, rising.
    pub columns: &'a [usize],
    /// Whether "#" and "//" begin remarks.
    pub has_remarks: bool,
    /// Number of the first line in the file.
    pub first: usize,
}

/// The wanted columns of all lines that are not empty, row after row.
///
/// # Errors
/// [`Error::Word`] for what is no number, [`Error::Width`] for lines of another length,
/// [`Error::Memory`], and [`Error::Stopped`] when the caller does not want to go on.
pub fn parse<T: FromStr>(text: &[u8], lines: &Lines, workers: &Workers) -> Result<Vec<T>, Error> {
    let n_lines = text.split(|&byte| byte == b'\n').count();
    let mut numbers = Vec::with_room(n_lines * lines.columns.len())?;
    for (row, line) in text.split(|&byte| byte == b'\n').enumerate() {
        if row % LINES == 0 {
            workers.check()?;
        }
        let line = if lines.has_remarks { before_remark(line) } else { line }.trim_ascii();
        if !line.is_empty() {
            parse_line(line, lines, lines.first + row, &mut numbers)?;
        }
    }
    Ok(numbers)
}

fn before_remark(line: &[u8]) -> &[u8] {
    let is_remark = |at: usize| match &line[at..] {
        [b'#', word @ ..] => !SPOILT.iter().any(|spoilt| word.starts_with(spoilt)),
        rest => rest.starts_with(b"//"),
    };
    (0..line.len()).find(|&at| is_remark(at)).map_or(line, |end| &line[..end])
}

fn parse_line<T: FromStr>(
    line: &[u8],
    lines: &Lines,
    number: usize,
    numbers: &mut Vec<T>,
) -> Result<(), Error> {
    let mut wanted = lines.columns.iter().peekable();
    let mut n_columns = 0;
    for word in (Words { rest: Some(line), separator: lines.separator }) {
        if wanted.next_if(|&&column| column == n_columns).is_some() {
            let value = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            numbers.push(value.ok_or_else(|| Error::Word {
                line: number,
                column: n_columns + 1,
                word: String::from_utf8_lossy(word).chars().take(40).collect(),
            })?);
        }
        n_columns += 1;
    }
    if n_columns == lines.n_columns {
        return Ok(());
    }
    Err(Error::Width { line: number, expected: lines.n_columns, found: n_columns })
}

/// The words of a line, without the quotes around them.
struct Words<'a> {
    rest: Option<&'a [u8]>,
    separator: Option<u8>,
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.rest?.trim_ascii_start();
        if rest.is_empty() && self.separator.is_none() {
            return None;
        }
        let quoted = match rest {
            [b'"', inside @ ..] => inside.iter().position(|&byte| byte == b'"'),
            _ => None,
        };
        let from = quoted.map_or(0, |end| end + 2);
        let is_end = |byte: &u8| match self.separator {
            Some(separator) => *byte == separator,
            None => byte.is_ascii_whitespace(),
        };
        let end = rest[from..].iter().position(is_end).map(|end| from + end);
        self.rest = end.map(|end| &rest[end + 1..]);
        let word = rest[..end.unwrap_or(rest.len())].trim_ascii_end();
        Some(quoted.map_or(word, |end| &rest[1..=end]))
    }
}

/// A column of numbers.
pub enum Column<'a> {
    /// Written with as many digits as tell them from all others.
    F64(&'a [f64]),
    /// The same in single precision.
    F32(&'a [f32]),
    /// Whole numbers.
    I64(&'a [i64]),
    /// Whole numbers without a sign.
    U64(&'a [u64]),
}

impl Column<'_> {
    /// How many numbers there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::F64(values) => values.len(),
            Self::F32(values) => values.len(),
            Self::I64(values) => values.len(),
            Self::U64(values) => values.len(),
        }
    }

    /// Whether there is no number.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn write(&self, row: usize, text: &mut Vec<u8>) -> std::io::Result<()> {
        match self {
            Self::F64(values) => write_float(values[row].is_nan(), &values[row], text),
            Self::F32(values) => write_float(values[row].is_nan(), &values[row], text),
            Self::I64(values) => write!(text, "{}", values[row]),
            Self::U64(values) => write!(text, "{}", values[row]),
        }
    }
}

fn write_float(
    is_nan: bool,
    value: &impl std::fmt::Debug,
    text: &mut Vec<u8>,
) -> std::io::Result<()> {
    if is_nan {
        return text.write_all(b"nan");
    }
    write!(text, "{value:?}")?;
    if text.ends_with(b".0") {
        text.truncate(text.len() - 2);
    }
    Ok(())
}

/// The rows of columns of one length, a line each.
///
/// # Errors
/// [`Error::Memory`], and [`Error::Stopped`] when the caller does not want to go on.
pub fn format(columns: &[Column], separator: u8, workers: &Workers) -> Result<Vec<u8>, Error> {
    let n = columns.first().map_or(0, Column::len);
    let mut text = Vec::with_room(n * columns.len() * WORD)?;
    for row in 0..n {
        if row % LINES == 0 {
            workers.check()?;
        }
        for column in columns {
            // Writing to memory that is there does not fail.
            column.write(row, &mut text).map_err(|_| Error::Stopped)?;
            text.push(separator);
        }
        if let Some(last) = text.last_mut() {
            *last = b'\n';
        }
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str, separator: Option<u8>, n_columns: usize) -> Result<Vec<f64>, Error> {
        let columns: Vec<usize> = (0..n_columns).collect();
        let lines = Lines { separator, n_columns, columns: &columns, has_remarks: true, first: 7 };
        parse(text.as_bytes(), &lines, &Workers::new(Some(1), &|| true)?)
    }

    #[test]
    fn words_are_parted_by_any_white_space_or_by_one_mark() {
        let numbers = vec![1.0, 2.5, -3e2, 4.0, f64::INFINITY, 6.0];
        assert_eq!(parsed(" 1 \t2.5  -3e2\r\n\n4 inf 6 # end\n// all\n", None, 3), Ok(numbers));
        assert_eq!(parsed("1, \"2\" ,3\n\"4\",5 ,6", Some(b','), 3).map(|all| all.len()), Ok(6));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let word = Error::Word { line: 8, column: 2, word: "1.0D+00".into() };
        assert_eq!(parsed("1 2\n1 1.0D+00\n", None, 2), Err(word));
        let width = Error::Width { line: 7, expected: 2, found: 3 };
        assert_eq!(parsed("1 2 3", None, 2), Err(width));
        let empty = Error::Word { line: 7, column: 2, word: String::new() };
        assert_eq!(parsed("1,,3", Some(b','), 3), Err(empty));
    }

    #[test]
    fn numbers_come_back_as_they_were() -> Result<(), Error> {
        let values = [0.1, -1e300, 5e-324, 1.0, f64::MIN_POSITIVE, -123_456.789, 1e22];
        let workers = Workers::new(Some(1), &|| true)?;
        let text = format(&[Column::F64(&values), Column::I64(&[i64::MIN; 7])], b' ', &workers)?;
        let text = String::from_utf8_lossy(&text).into_owned();
        let again = parsed(&text, None, 2)?;
        assert_eq!(again.iter().step_by(2).copied().collect::<Vec<_>>(), values);
        assert_eq!(text.lines().nth(3), Some("1 -9223372036854775808"));
        let nan = format(&[Column::F32(&[f32::NAN, 0.1])], b' ', &workers)?;
        assert_eq!(nan, b"nan\n0.1\n");
        Ok(())
    }
}
