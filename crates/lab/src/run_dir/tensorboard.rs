//! Event files as TensorBoard reads them: records of messages, each with two checksums.
//!
//! A record is the message's length (8 bytes), its masked CRC-32C (4), the message, its masked CRC-32C (4), all little-endian. The wall time
//! of every event is 0, so that the same run gives the same file; TensorBoard's axis is the step.

use lanecraft_net::protobuf::Message;

/// The first record, which says what file this is.
pub(crate) fn header() -> Vec<u8> {
    record(&Message::default().double(1, 0.0).bytes(3, "brain.Event:2").into_bytes())
}

/// Numbers at a step, by their tags.
pub(crate) fn scalars(step: u64, values: &[(&str, f64)]) -> Vec<u8> {
    let value = |&(tag, value): &(&str, f64)| Message::default().bytes(1, tag).float(2, value as f32);
    let summary = Message::default().messages(1, values.iter().map(value));
    record(&Message::default().double(1, 0.0).integer(2, step).message(5, &summary).into_bytes())
}

fn record(message: &[u8]) -> Vec<u8> {
    let length = (message.len() as u64).to_le_bytes();
    let mut bytes = length.to_vec();
    bytes.extend(masked_crc(&length).to_le_bytes());
    bytes.extend(message);
    bytes.extend(masked_crc(message).to_le_bytes());
    bytes
}

/// The checksum, turned and shifted, so that checksums of what holds checksums are no trouble.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

/// CRC-32C (Castagnoli), bit by bit: a few hundred bytes for each point of a curve.
fn crc32c(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0x82f6_3b78 & (crc & 1).wrapping_neg()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 3720, B.4: 32 zeros, 32 ones and the check value of the algorithm.
    #[test]
    fn checksums_are_the_published_ones() {
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
    }

    #[test]
    fn a_record_frames_its_message() {
        let bytes = scalars(7, &[("reward", 0.5)]);
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        assert_eq!(bytes.len(), 8 + 4 + length + 4);
        assert!(bytes.windows(6).any(|window| window == b"reward"));
        assert!(header().windows(13).any(|window| window == b"brain.Event:2"));
    }
}
