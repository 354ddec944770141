//! Logs that grow by whole records, as JSON lines, CSV or bytes, and are cut back to the length a checkpoint knows.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::RunDirError;

/// An open log of a run.
#[derive(Debug)]
pub struct RunLog {
    file: File,
    path: PathBuf,
    len_bytes: u64,
}

impl RunLog {
    /// Starts an empty log; one that exists is emptied.
    pub fn create(path: &Path) -> Result<Self, RunDirError> {
        Self::open(path, true, 0)
    }

    /// Continues a log after its first `len_bytes`, which a checkpoint knows; what was written later is dropped, because the run that
    /// continues from the checkpoint writes it again.
    pub fn resume(path: &Path, len_bytes: u64) -> Result<Self, RunDirError> {
        Self::open(path, len_bytes == 0, len_bytes)
    }

    /// Length so far, for the checkpoint.
    pub fn len_bytes(&self) -> u64 {
        self.len_bytes
    }

    /// Appends one JSON object as a line.
    pub fn json<T: Serialize>(&mut self, record: &T) -> Result<(), RunDirError> {
        let mut line = serde_json::to_vec(record).map_err(|error| self.broken(&error))?;
        line.push(b'\n');
        self.append(&line)
    }

    /// Appends one flat record as a CSV row, before the first one also its column names.
    pub fn csv<T: Serialize>(&mut self, record: &T) -> Result<(), RunDirError> {
        let mut writer = csv::WriterBuilder::new().has_headers(self.len_bytes == 0).from_writer(Vec::new());
        writer.serialize(record).map_err(|error| self.broken(&error))?;
        let line = writer.into_inner().map_err(|error| self.broken(&error))?;
        self.append(&line)
    }

    /// Makes all lines durable; to be called before a checkpoint that counts on them.
    pub fn sync(&mut self) -> Result<(), RunDirError> {
        self.file.sync_data().map_err(RunDirError::io("write", &self.path))
    }

    fn open(path: &Path, create: bool, len_bytes: u64) -> Result<Self, RunDirError> {
        let open = || -> io::Result<(File, u64)> {
            let file = OpenOptions::new().write(true).create(create).truncate(false).open(path)?;
            let found = file.metadata()?.len();
            Ok((file, found))
        };
        let (mut file, found) = open().map_err(RunDirError::io("open", path))?;
        if found < len_bytes {
            return Err(RunDirError::LogTooShort { path: path.to_owned(), found, expected: len_bytes });
        }
        let cut = if found > len_bytes { file.set_len(len_bytes) } else { Ok(()) };
        cut.and_then(|()| file.seek(SeekFrom::Start(len_bytes)).map(drop)).map_err(RunDirError::io("open", path))?;
        Ok(Self { file, path: path.to_owned(), len_bytes })
    }

    /// Appends a record as it is. One that fits only in part, as on a full disk, is taken back.
    pub fn append(&mut self, record: &[u8]) -> Result<(), RunDirError> {
        match self.file.write_all(record) {
            Ok(()) => {
                self.len_bytes += record.len() as u64;
                Ok(())
            }
            Err(error) => {
                // The first error is the one to report.
                let _ = self.file.set_len(self.len_bytes);
                let _ = self.file.seek(SeekFrom::Start(self.len_bytes));
                Err(RunDirError::io("write", &self.path)(error))
            }
        }
    }

    fn broken(&self, error: &dyn std::fmt::Display) -> RunDirError {
        RunDirError::Broken { path: self.path.clone(), message: error.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use serde::Serialize;

    use super::RunLog;

    #[derive(Serialize)]
    struct Row {
        decisions: u64,
        loss: f64,
    }

    #[test]
    fn a_resumed_log_is_that_of_an_uninterrupted_run() {
        let folder = tempfile::tempdir().unwrap();
        let [whole, cut] = ["whole", "cut"].map(|name| folder.path().join(name));
        let rows = [1, 2, 3].map(|decisions| Row { decisions, loss: 0.5 });
        let mut log = RunLog::create(&whole).unwrap();
        for row in &rows {
            log.csv(row).unwrap();
        }

        let mut log = RunLog::create(&cut).unwrap();
        log.csv(&rows[0]).unwrap();
        log.sync().unwrap();
        let checkpoint = log.len_bytes();
        log.csv(&rows[1]).unwrap();
        drop(log);
        let mut log = RunLog::resume(&cut, checkpoint).unwrap();
        for row in &rows[1..] {
            log.csv(row).unwrap();
        }
        assert_eq!(fs::read_to_string(&whole).unwrap(), "decisions,loss\n1,0.5\n2,0.5\n3,0.5\n");
        assert_eq!(fs::read(&whole).unwrap(), fs::read(&cut).unwrap());
    }

    #[test]
    fn json_is_one_object_a_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.jsonl");
        let mut log = RunLog::create(&path).unwrap();
        log.json(&Row { decisions: 1, loss: 2.0 }).unwrap();
        log.json(&Row { decisions: 2, loss: 1.0 }).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text, "{\"decisions\":1,\"loss\":2.0}\n{\"decisions\":2,\"loss\":1.0}\n");
        assert_eq!(log.len_bytes(), text.len() as u64);
    }

    #[test]
    fn a_log_that_lost_lines_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        assert!(RunLog::resume(&path, 10).unwrap_err().to_string().contains("log.csv"));
        fs::write(&path, "12345").unwrap();
        let message = RunLog::resume(&path, 10).unwrap_err().to_string();
        assert!(message.contains("has 5 bytes") && message.contains("counts on 10"), "{message}");
        assert_eq!(fs::read(&path).unwrap(), b"12345");
    }

    /// `/dev/full` takes nothing, like a full disk.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_with_the_name_of_the_file() {
        let mut log = RunLog::create(std::path::Path::new("/dev/full")).unwrap();
        let message = log.json(&Row { decisions: 1, loss: 2.0 }).unwrap_err().to_string();
        assert!(message.contains("/dev/full") && message.contains("No space left"), "{message}");
        assert_eq!(log.len_bytes(), 0);
    }
}
