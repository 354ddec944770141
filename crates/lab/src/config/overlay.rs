//! A table of values over which files and assignments are laid, key by key.
//!
//! The table at the start is complete: its keys are the keys that exist, and the type of each value is the type of its key. Arrays are
//! values, not tables: they are replaced as a whole. So are tables with a `kind`, for it decides which keys stand beside it; the
//! keys of the kind that holds may be given values one by one, too.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::Path;

use toml::de::{DeTable, DeValue, ValueDeserializer};
use toml::{Spanned, Table, Value};

use super::error::{ConfigFileError, Origin};

/// Largest configuration file that is read.
const FILE_LIMIT_BYTES: u64 = 1 << 20;

/// Says whether a complete table still fits the structs it stands for.
pub type Probe = fn(&Table) -> Result<(), toml::de::Error>;

/// A complete table and what was laid over it.
#[derive(Debug)]
pub struct Overlay {
    table: Table,
    preset: &'static str,
    origins: BTreeMap<String, Origin>,
    probe: Probe,
}

impl Overlay {
    /// Starts from the complete `table` of the preset of this name.
    pub fn new(preset: &'static str, table: Table, probe: Probe) -> Self {
        Self { table, preset, origins: BTreeMap::new(), probe }
    }

    /// Lays a TOML file over the table.
    pub fn file(&mut self, path: &Path) -> Result<(), ConfigFileError> {
        let read = |source| ConfigFileError::Read { path: path.to_owned(), source };
        let mut text = String::new();
        let file = std::fs::File::open(path).map_err(read)?;
        file.take(FILE_LIMIT_BYTES + 1).read_to_string(&mut text).map_err(read)?;
        if text.len() as u64 > FILE_LIMIT_BYTES {
            return Err(ConfigFileError::TooLarge { path: path.to_owned(), limit_bytes: FILE_LIMIT_BYTES });
        }
        self.text(path, &text)
    }

    /// Lays a TOML text over the table; `path` is where it came from.
    pub fn text(&mut self, path: &Path, text: &str) -> Result<(), ConfigFileError> {
        let at = |offset: usize| {
            let line = 1 + text.bytes().take(offset).map(|byte| u32::from(byte == b'\n')).sum::<u32>();
            Origin::File { path: path.into(), line }
        };
        let document = DeTable::parse(text).map_err(|error| ConfigFileError::Syntax {
            origin: at(error.span().map_or(0, |span| span.start)),
            message: error.message().to_owned(),
        })?;
        let mut leaves = Vec::new();
        collect_leaves("", document.get_ref(), &mut leaves);
        for (key, offset, value) in leaves {
            let origin = at(offset);
            let value = plain(value).map_err(|message| ConfigFileError::Syntax { origin: origin.clone(), message })?;
            self.assign(origin, &key, value)?;
        }
        Ok(())
    }

    /// Lays `key=value` over the table. The value is TOML; a bare word stands for a string where the key holds one.
    pub fn set(&mut self, assignment: &str) -> Result<(), ConfigFileError> {
        let Some((key, text)) = assignment.split_once('=') else {
            return Err(ConfigFileError::NoAssignment { text: assignment.to_owned() });
        };
        let (key, text) = (key.trim(), text.trim());
        let parsed = ValueDeserializer::parse(text).ok().and_then(|value| {
            use serde::Deserialize as _;
            Value::deserialize(value).ok()
        });
        let value = match (parsed, self.get(key)) {
            (Some(value), Some(Value::String(_))) if !value.is_str() => Value::String(text.to_owned()),
            (Some(value), _) => value,
            (None, _) => Value::String(text.to_owned()),
        };
        self.assign(Origin::CommandLine, key, value)
    }

    /// Lays the values of a program that called over the table; keys may be nested or dotted.
    pub fn values(&mut self, values: &Table) -> Result<(), ConfigFileError> {
        self.values_below("", values)
    }

    fn values_below(&mut self, prefix: &str, values: &Table) -> Result<(), ConfigFileError> {
        for (name, value) in values {
            let key = format!("{prefix}{name}");
            match value {
                Value::Table(inner) if is_section(value) => self.values_below(&format!("{key}."), inner)?,
                _ => self.assign(Origin::Caller, &key, value.clone())?,
            }
        }
        Ok(())
    }

    /// Gives `key` a value, if the key exists and the value has its type and is known to it.
    pub fn assign(&mut self, origin: Origin, key: &str, value: Value) -> Result<(), ConfigFileError> {
        let Some(old) = self.get(key) else { return Err(self.unknown_key(origin, key, &value)) };
        if !all_finite(&value) {
            return Err(ConfigFileError::NotFinite { origin, key: key.to_owned(), value: value.to_string() });
        }
        let value = match (old, value) {
            (Value::Float(_), Value::Integer(whole)) => Value::Float(whole as f64),
            (old, new) if old.same_type(&new) => new,
            (old, new) => {
                let expected = type_in_words(old);
                return Err(ConfigFileError::WrongType {
                    origin,
                    key: key.to_owned(),
                    value: new.to_string(),
                    expected,
                });
            }
        };
        let shown = value.to_string();
        put(&mut self.table, key, value);
        (self.probe)(&self.table).map_err(|error| unknown_value(origin.clone(), key, shown, error.message()))?;
        let inner = format!("{key}.");
        self.origins.retain(|name, _| !name.starts_with(&inner));
        self.origins.insert(key.to_owned(), origin);
        Ok(())
    }

    /// The table as it stands.
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// Where the value of `key`, or the table as a whole that holds it, was written.
    pub fn origin(&self, key: &str) -> Origin {
        let outer = || self.origins.get(key.rsplit_once('.')?.0);
        self.origins.get(key).or_else(outer).cloned().unwrap_or(Origin::Preset(self.preset))
    }

    /// The value of `key`; none if there is no such key, or if it is a section.
    fn get(&self, key: &str) -> Option<&Value> {
        let mut parts = key.split('.');
        let first = self.table.get(parts.next()?)?;
        parts.try_fold(first, |value, part| value.as_table()?.get(part)).filter(|value| !is_section(value))
    }

    fn unknown_key(&self, origin: Origin, key: &str, value: &Value) -> ConfigFileError {
        let keys = dotted_keys(&self.table);
        let section = key.rsplit_once('.').map_or("", |(section, _)| section);
        let mut allowed: Vec<String> =
            keys.iter().filter(|name| name.rsplit_once('.').is_some_and(|(s, _)| s == section)).cloned().collect();
        if allowed.is_empty() {
            allowed = self.table.keys().map(|name| format!("[{name}]")).collect();
        }
        let near = if key.contains('.') {
            nearest(key, keys.iter().map(String::as_str))
        } else {
            let last = |name: &str| name.rsplit('.').next().unwrap_or_default().to_owned();
            let lasts: Vec<String> = keys.iter().map(|name| last(name)).collect();
            let found = nearest(key, lasts.iter().map(String::as_str));
            found.and_then(|found| keys.iter().map(String::as_str).find(|name| last(name) == found))
        };
        let nearest = near.map(Into::into);
        ConfigFileError::UnknownKey {
            origin,
            key: key.to_owned(),
            value: value.to_string(),
            nearest,
            allowed: allowed.into(),
        }
    }
}

/// The dotted keys of a table, sorted.
pub fn dotted_keys(table: &Table) -> Vec<String> {
    let mut keys = Vec::new();
    for (name, value) in table {
        match value {
            Value::Table(inner) => keys.extend(dotted_keys(inner).into_iter().map(|key| format!("{name}.{key}"))),
            _ => keys.push(name.clone()),
        }
    }
    keys.sort();
    keys
}

/// The name most like `name`, if any is like it; the first of equals.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Jaro-Winkler forgives a missing end, Damerau-Levenshtein a slip in the middle; the bound of the first keeps out strangers.
    const ALIKE: f64 = 0.75;
    let mut best: Option<(&str, f64)> = None;
    for candidate in candidates {
        let jaro = strsim::jaro_winkler(name, candidate);
        // A name cut short, perhaps with a slip in it as well, is the likeliest mistake with long names.
        let shortened = shortened_alike(name, candidate);
        let score = jaro + strsim::normalized_damerau_levenshtein(name, candidate).max(shortened);
        if jaro.max(shortened) >= ALIKE && best.is_none_or(|(_, highest)| score > highest) {
            best = Some((candidate, score));
        }
    }
    best.map(|(candidate, _)| candidate)
}

/// How alike `name` is to `candidate` cut off behind one of its words; a whole match of a part counts almost like one of the whole.
fn shortened_alike(name: &str, candidate: &str) -> f64 {
    let ends = candidate.match_indices('_').map(|(end, _)| &candidate[..end]);
    0.99 * ends.map(|part| strsim::normalized_damerau_levenshtein(name, part)).fold(0.0, f64::max)
}

fn collect_leaves<'a, 'i>(prefix: &str, table: &'a DeTable<'i>, leaves: &mut Vec<(String, usize, &'a DeValue<'i>)>) {
    for (name, value) in table {
        let key = if prefix.is_empty() { name.get_ref().to_string() } else { format!("{prefix}.{}", name.get_ref()) };
        match value.get_ref() {
            DeValue::Table(inner) if !inner.contains_key("kind") => collect_leaves(&key, inner, leaves),
            leaf => leaves.push((key, name.span().start, leaf)),
        }
    }
    leaves.sort_by_key(|&(_, offset, _)| offset);
}

fn plain(value: &DeValue<'_>) -> Result<Value, String> {
    use serde::Deserialize as _;
    let whole = 0..0;
    Value::deserialize(ValueDeserializer::from(Spanned::new(whole, value.clone())))
        .map_err(|error| error.message().to_owned())
}

/// Whether this is a table of keys with values of their own.
fn is_section(value: &Value) -> bool {
    value.as_table().is_some_and(|table| !table.contains_key("kind"))
}

fn put(table: &mut Table, key: &str, value: Value) {
    match key.split_once('.') {
        Some((section, rest)) => {
            if let Some(Value::Table(inner)) = table.get_mut(section) {
                put(inner, rest, value);
            }
        }
        None => {
            table.insert(key.to_owned(), value);
        }
    }
}

fn all_finite(value: &Value) -> bool {
    match value {
        Value::Float(number) => number.is_finite(),
        Value::Array(items) => items.iter().all(all_finite),
        Value::Table(table) => table.iter().all(|(_, item)| all_finite(item)),
        _ => true,
    }
}

fn type_in_words(value: &Value) -> &'static str {
    match value {
        Value::String(_) => "a name in quotes",
        Value::Integer(_) => "a whole number",
        Value::Float(_) => "a number",
        Value::Boolean(_) => "true or false",
        Value::Datetime(_) => "a date",
        Value::Array(_) => "a list in brackets",
        Value::Table(_) => "a table with a `kind`",
    }
}

/// serde names what it allows in backquotes after the word `expected`; what it found stands before it.
fn unknown_value(origin: Origin, key: &str, value: String, message: &str) -> ConfigFileError {
    let reason = message.lines().next().unwrap_or_default().to_owned();
    let (found, allowed) = reason.split_once("expected").unwrap_or_default();
    let quoted = |text| str::split(text, '`').skip(1).step_by(2);
    let nearest = quoted(found).next().and_then(|name| nearest(name, quoted(allowed))).map(Into::into);
    ConfigFileError::UnknownValue { origin, key: key.to_owned(), value, reason, nearest }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use serde::{Deserialize, Serialize};
    use toml::{Table, Value};

    use super::{Origin, Overlay, dotted_keys, nearest};

    #[derive(Default, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Tires {
        #[default]
        Linear,
        MagicFormula,
    }

    #[derive(Default, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Car {
        tires: Tires,
        mass_kg: f64,
        wheels: u8,
        lights: bool,
        gears: Vec<f64>,
    }

    #[derive(Serialize, Deserialize)]
    #[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
    enum Politeness {
        Fixed { value: f64 },
        Uniform { min: f64, max: f64 },
    }

    impl Default for Politeness {
        fn default() -> Self {
            Self::Fixed { value: 0.3 }
        }
    }

    #[derive(Default, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Traffic {
        density_veh_per_km_lane: f64,
        min_gap_m: f64,
        politeness: Politeness,
    }

    #[derive(Default, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct All {
        car: Car,
        traffic: Traffic,
    }

    fn overlay() -> Overlay {
        Overlay::new("default", Table::try_from(All::default()).unwrap(), |table| {
            table.clone().try_into::<All>().map(drop)
        })
    }

    fn refuse(assignment: &str) -> String {
        overlay().set(assignment).unwrap_err().to_string()
    }

    #[test]
    fn values_are_laid_over_and_whole_numbers_become_real() {
        let mut overlay = overlay();
        overlay.text(Path::new("a.toml"), "[car]\nmass_kg = 1300\ngears = [3.5, 2]\n").unwrap();
        overlay.set("car.tires=magic-formula").unwrap();
        overlay.set("car.lights = true").unwrap();
        let all: All = overlay.table().clone().try_into().unwrap();
        assert_eq!(all.car.mass_kg, 1300.0);
        assert_eq!(all.car.gears, [3.5, 2.0]);
        assert!(matches!(all.car.tires, Tires::MagicFormula) && all.car.lights);
        assert_eq!(overlay.origin("car.mass_kg").to_string(), "a.toml:2");
        assert_eq!(overlay.origin("car.wheels").to_string(), "preset default");
    }

    #[test]
    fn a_table_with_a_kind_is_replaced_as_a_whole_or_changed_in_part() {
        let mut overlay = overlay();
        overlay.set("traffic.politeness.value=1").unwrap();
        assert_eq!(overlay.origin("traffic.politeness.value"), Origin::CommandLine);
        let whole = "[traffic.politeness]\nkind = \"uniform\"\nmin = 0\nmax = 0.5\n";
        overlay.text(Path::new("a.toml"), whole).unwrap();
        assert_eq!(overlay.origin("traffic.politeness.max").to_string(), "a.toml:1");
        overlay.set("traffic.politeness.max=0.4").unwrap();
        let all: All = overlay.table().clone().try_into().unwrap();
        assert!(matches!(all.traffic.politeness, Politeness::Uniform { min: 0.0, max: 0.4 }));
        let message =
            overlay.set("traffic.politeness={ kind = \"unifrm\", min = 0, max = 1 }").unwrap_err().to_string();
        assert!(message.contains("did you mean `uniform`?"), "{message}");
        assert!(refuse("traffic.politeness=0.5").contains("must be a table with a `kind`"));
        assert!(refuse("traffic.politeness.kind=uniform").contains("expected `min` or `max`"));
        assert!(refuse("traffic.politeness.max=1").contains("no key `traffic.politeness.max`"));
    }

    #[test]
    fn a_misspelt_key_is_named_with_the_nearest() {
        for (written, nearest) in [
            ("car.mas_kg=1", "car.mass_kg"),
            ("trafic.min_gap_m=1", "traffic.min_gap_m"),
            ("traffic.density=1", "traffic.density_veh_per_km_lane"),
            ("traffic.densty=1", "traffic.density_veh_per_km_lane"),
            ("min_gap_m=1", "traffic.min_gap_m"),
            ("density_veh_km_lane=1", "traffic.density_veh_per_km_lane"),
        ] {
            let message = refuse(written);
            assert!(message.contains(&format!("did you mean `{nearest}`?")), "{message}");
        }
        assert!(refuse("car.xyzzy=1").contains("allowed are car.gears, car.lights, car.mass_kg"));
        assert!(refuse("qqqq=1").contains("allowed are [car], [traffic]"));
        assert!(refuse("car=1").contains("no key `car`"));
    }

    #[test]
    fn a_wrong_type_is_named() {
        assert_eq!(refuse("car.mass_kg=heavy"), "command line: `car.mass_kg` is \"heavy\", but must be a number");
        assert_eq!(refuse("car.wheels=4.5"), "command line: `car.wheels` is 4.5, but must be a whole number");
        assert!(refuse("car.lights=1").contains("must be true or false"));
        assert!(refuse("car.gears=3").contains("must be a list"));
        assert!(refuse("car.mass_kg=").contains("must be a number"));
        assert!(refuse("car.mass_kg").contains("write it as `key=value`"));
    }

    #[test]
    fn no_nan_and_no_infinity_gets_in() {
        for text in ["nan", "-nan", "inf", "-inf"] {
            assert!(refuse(&format!("car.mass_kg={text}")).contains("finite number"), "{text}");
        }
        assert!(refuse("car.mass_kg=1e400").contains("must be a number"));
        assert!(refuse("car.gears=[1.0, nan]").contains("finite number"));
    }

    #[test]
    fn an_unknown_name_is_answered_with_the_nearest() {
        let message = refuse("car.tires=magic");
        assert!(message.contains("`car.tires` is \"magic\"") && message.contains("did you mean `magic-formula`?"));
        assert!(refuse("car.wheels=-1").contains("`car.wheels` is -1"));
        assert!(refuse("car.wheels=300").contains("`car.wheels` is 300"));
    }

    #[test]
    fn a_file_is_refused_by_line() {
        let refuse = |text: &str| overlay().text(Path::new("my.toml"), text).unwrap_err().to_string();
        assert!(refuse("[car]\n\nmas_kg = 1\n").starts_with("my.toml:3: there is no key `car.mas_kg`"));
        assert!(refuse("# note\n[car]\nmass_kg = = 1\n").starts_with("my.toml:3: "));
        assert!(refuse("[car]\nmass_kg = 1\nmass_kg = 2\n").starts_with("my.toml:3: duplicate key"));
        assert!(refuse("[car]\nwheels = 2\n[traffic]\nmin_gap_m = nan").starts_with("my.toml:4: "));
        let missing = overlay().file(Path::new("/nowhere/my.toml")).unwrap_err().to_string();
        assert!(missing.starts_with("cannot read /nowhere/my.toml"), "{missing}");
    }

    #[test]
    fn keys_are_dotted_and_sorted() {
        let table = Table::from_iter([("b".into(), Value::Table(Table::from_iter([("x".into(), Value::Integer(1))])))]);
        assert_eq!(dotted_keys(&table), ["b.x"]);
    }

    #[test]
    fn strangers_are_not_near() {
        assert_eq!(nearest("best-lan", ["keep-lane", "best-lane", "random"]), Some("best-lane"));
        let gaps = ["traffic.politeness", "traffic.density_veh_per_km_lane", "traffic.density_spread_veh_per_km_lane"];
        assert_eq!(nearest("traffic.density", gaps), Some(gaps[1]));
        assert_eq!(nearest("qqq", ["keep-lane", "best-lane", "random"]), None);
    }
}
