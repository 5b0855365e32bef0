//! Marc Lehmann's LZF, the compression of PCD files: runs of literal bytes, and references to decompressed bytes.

/// Decompresses to exactly `size` bytes; `None` if the data give another size. Never allocates more than `size` bytes,
/// nor much more than the data can decompress to.
pub(crate) fn decompress(data: &[u8], size: usize) -> Option<Vec<u8>> {
    // Three bytes expand to at most a reference of 264 bytes.
    if size / 264 > data.len() / 3 + 1 {
        return None;
    }
    let mut out = Vec::with_capacity(size);
    let mut rest = data;
    while let Some(control) = rest.split_off_first() {
        if *control < 32 {
            out.extend_from_slice(rest.split_off(..=usize::from(*control))?);
        } else {
            copy_reference(*control, &mut rest, &mut out, size)?;
        }
        if out.len() > size {
            return None;
        }
    }
    (out.len() == size).then_some(out)
}

fn copy_reference(control: u8, rest: &mut &[u8], out: &mut Vec<u8>, size: usize) -> Option<()> {
    let mut length = usize::from(control >> 5);
    if length == 7 {
        length += usize::from(*rest.split_off_first()?);
    }
    length += 2;
    let back = (usize::from(control & 31) << 8) + usize::from(*rest.split_off_first()?) + 1;
    let from = out.len().checked_sub(back)?;
    if length > size - out.len() {
        return None;
    }
    // Byte by byte, because a reference may overlap its own output.
    for at in from..from + length {
        out.push(out[at]);
    }
    Some(())
}

#[cfg(test)]
pub(crate) mod tests;
