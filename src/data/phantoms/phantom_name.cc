#include <algorithm>
#include <charconv>
#include <cmath>

#include "phantoms/phantom_keys.h"

namespace palpate {
namespace {

// shortest text that parses to the same number
std::string text_of(double value) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  return {text, end};
}

std::string joined(std::span<const std::string_view> words, std::string_view between) {
  std::string text;
  for (const std::string_view word : words)
    text += (text.empty() ? "" : std::string(between)) + std::string(word);
  return text;
}

std::string range_text(double smallest, double largest, std::string_view unit) {
  return text_of(smallest) + " ... " + text_of(largest) + (unit.empty() ? "" : " " + std::string(unit));
}

std::string edges_text(const Eigen::Vector3d& edges) {
  if (edges[0] == edges[1] && edges[1] == edges[2]) return text_of(edges[0]);
  return text_of(edges[0]) + "x" + text_of(edges[1]) + "x" + text_of(edges[2]);
}

// Descriptions of the values of each key: "side left or right, spacing 0.2 ... 3 mm".
class Describer final : public PhantomKeyVisitor {
 public:
  void number(const PhantomKey& key, double smallest, double largest, double&) override {
    add(key, range_text(smallest, largest, key.unit));
  }
  void integer(const PhantomKey& key, std::uint64_t largest, std::uint64_t&) override {
    add(key, "0 ... " + std::to_string(largest));
  }
  void edges(const PhantomKey& key, double smallest, double largest, Eigen::Vector3d&) override {
    add(key, range_text(smallest, largest, key.unit) + ", one number or three (0.28x0.28x1)");
  }
  void word(const PhantomKey& key, std::span<const std::string_view> words, std::string&) override {
    add(key, joined(words, " or "));
  }
  void words(const PhantomKey& key, std::span<const std::string_view> words,
             std::vector<std::string>&) override {
    add(key, "any of " + joined(words, ", ") + ", joined by +");
  }

  struct Line {
    std::string key, values;
  };
  std::vector<Line> lines;

 private:
  void add(const PhantomKey& key, std::string values) {
    lines.push_back({std::string(key.name), std::move(values)});
  }
};

std::vector<Describer::Line> described(PhantomParameters parameters) {
  Describer describer;
  visit_keys(parameters, describer);
  return describer.lines;
}

std::string values_of(const PhantomParameters& parameters, std::string_view key) {
  for (const Describer::Line& line : described(parameters))
    if (line.key == key) return line.values;
  return {};
}

std::string known_keys(const PhantomParameters& parameters) {
  std::string text = "its keys are";
  for (const Describer::Line& line : described(parameters)) text += "\n    " + line.key + ": " + line.values;
  return text;
}

Error out_of_range(const PhantomParameters& parameters, std::string_view key) {
  return {ErrorKind::kBadInput, "`" + std::string(key) + "` is " + values_of(parameters, key),
          base_name(parameters), ""};
}

// Finds the first key with a value out of range.
class RangeCheck final : public PhantomKeyVisitor {
 public:
  void number(const PhantomKey& key, double smallest, double largest, double& value) override {
    expect(key, value >= smallest && value <= largest);
  }
  void integer(const PhantomKey& key, std::uint64_t largest, std::uint64_t& value) override {
    expect(key, value <= largest);
  }
  void edges(const PhantomKey& key, double smallest, double largest, Eigen::Vector3d& value) override {
    expect(key, (value.array() >= smallest).all() && (value.array() <= largest).all());
  }
  void word(const PhantomKey& key, std::span<const std::string_view> words, std::string& value) override {
    expect(key, std::ranges::find(words, value) != words.end());
  }
  void words(const PhantomKey& key, std::span<const std::string_view> words,
             std::vector<std::string>& values) override {
    bool good = std::ranges::is_sorted(values) && std::ranges::adjacent_find(values) == values.end();
    for (const std::string& value : values) good = good && std::ranges::find(words, value) != words.end();
    expect(key, good);
  }
  std::string_view wrong;

 private:
  void expect(const PhantomKey& key, bool good) {
    if (!good && wrong.empty()) wrong = key.name;
  }
};

// Parses the text of one key.
class Setter final : public PhantomKeyVisitor {
 public:
  Setter(std::string_view key, std::string_view text) : key_(key), text_(text) {}
  void number(const PhantomKey& key, double, double, double& value) override {
    if (key.name == key_) take(read(text_, value));
  }
  void integer(const PhantomKey& key, std::uint64_t, std::uint64_t& value) override {
    if (key.name == key_) take(read(text_, value));
  }
  void edges(const PhantomKey& key, double, double, Eigen::Vector3d& value) override {
    if (key.name != key_) return;
    const std::vector<std::string_view> parts = split(text_, 'x');
    bool good = parts.size() == 1 || parts.size() == 3;
    for (std::size_t a = 0; good && a < 3; ++a)
      good = read(parts[parts.size() == 1 ? 0 : a], value[static_cast<Eigen::Index>(a)]);
    take(good);
  }
  void word(const PhantomKey& key, std::span<const std::string_view> words, std::string& value) override {
    if (key.name != key_) return;
    value = text_;
    take(std::ranges::find(words, text_) != words.end());
  }
  void words(const PhantomKey& key, std::span<const std::string_view>,
             std::vector<std::string>& values) override {
    if (key.name != key_) return;
    for (const std::string_view part : split(text_, '+')) values.emplace_back(part);
    std::ranges::sort(values);
    take(true);
  }
  static std::vector<std::string_view> split(std::string_view text, char at) {
    std::vector<std::string_view> parts;
    for (;;) {
      const std::size_t end = std::min(text.find(at), text.size());
      parts.push_back(text.substr(0, end));
      if (end == text.size()) return parts;
      text.remove_prefix(end + 1);
    }
  }
  bool known = false, readable = false;

 private:
  void take(bool good) {
    known = true;
    readable = good;
  }
  template <class T>
  static bool read(std::string_view text, T& value) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    value += T{};  // avoids -0, which would yield another name
    return error == std::errc() && end == text.data() + text.size();
  }

  std::string_view key_, text_;
};

// Writes the text of every key.
class Writer final : public PhantomKeyVisitor {
 public:
  void number(const PhantomKey& key, double, double, double& value) override { add(key, text_of(value)); }
  void integer(const PhantomKey& key, std::uint64_t, std::uint64_t& value) override {
    add(key, std::to_string(value));
  }
  void edges(const PhantomKey& key, double, double, Eigen::Vector3d& value) override {
    add(key, edges_text(value));
  }
  void word(const PhantomKey& key, std::span<const std::string_view>, std::string& value) override {
    add(key, value);
  }
  void words(const PhantomKey& key, std::span<const std::string_view>,
             std::vector<std::string>& values) override {
    add(key, joined(std::vector<std::string_view>(values.begin(), values.end()), "+"));
  }
  std::vector<Describer::Line> lines;

 private:
  void add(const PhantomKey& key, std::string text) {
    lines.push_back({std::string(key.name), std::move(text)});
  }
};

std::vector<Describer::Line> written(PhantomParameters parameters) {
  Writer writer;
  visit_keys(parameters, writer);
  return writer.lines;
}

// Writes one row of the documentation for each key.
class Documenter final : public PhantomKeyVisitor {
 public:
  void number(const PhantomKey& key, double smallest, double largest, double& value) override {
    row(key, "a number", text_of(value), text_of(smallest) + " … " + text_of(largest));
  }
  void integer(const PhantomKey& key, std::uint64_t largest, std::uint64_t& value) override {
    row(key, "a whole number", std::to_string(value), "0 … " + std::to_string(largest));
  }
  void edges(const PhantomKey& key, double smallest, double largest, Eigen::Vector3d& value) override {
    row(key, "one or three numbers", edges_text(value), text_of(smallest) + " … " + text_of(largest));
  }
  void word(const PhantomKey& key, std::span<const std::string_view> words, std::string& value) override {
    row(key, "`" + joined(words, "`, `") + "`", value, "");
  }
  void words(const PhantomKey& key, std::span<const std::string_view> words,
             std::vector<std::string>&) override {
    row(key, "any of `" + joined(words, "`, `") + "`", "", "");
  }
  std::string text;

 private:
  void row(const PhantomKey& key, const std::string& value, const std::string& usual,
           const std::string& range) {
    text += "| `" + std::string(key.name) + "` | " + value + " | " +
            (usual.empty() ? "—" : "`" + usual + "`") + " | " + std::string(key.unit) + " | " + range +
            " | " + std::string(key.meaning) + " |\n";
  }
};

std::string all_names() {
  std::string names;
  for (const std::string& name : phantom_names()) names += (names.empty() ? "" : ", ") + name;
  return names;
}

}  // namespace

bool is_phantom_name(std::string_view name) {
  return std::ranges::find(phantom_names(), name.substr(0, name.find(':'))) != phantom_names().end();
}

Result<void> check_key_ranges(const PhantomParameters& parameters) {
  PhantomParameters copy = parameters;
  RangeCheck ranges;
  visit_keys(copy, ranges);
  if (!ranges.wrong.empty()) return out_of_range(parameters, ranges.wrong);
  return {};
}

Result<PhantomParameters> parse_phantom(std::string_view name) {
  const std::string_view base = name.substr(0, name.find(':'));
  const auto found = std::ranges::find(phantom_names(), base);
  if (found == phantom_names().end())
    return Error{ErrorKind::kBadInput, "there is no phantom of this name", std::string(name),
                 "the phantoms are " + all_names()};
  PhantomParameters parameters = mean_phantoms()[static_cast<std::size_t>(found - phantom_names().begin())];
  if (base.size() == name.size()) return parameters;

  std::vector<std::string_view> supplied;
  for (const std::string_view pair : Setter::split(name.substr(base.size() + 1), ',')) {
    const std::size_t equals = pair.find('=');
    if (equals == std::string_view::npos)
      return Error{ErrorKind::kBadInput, "a parameter is KEY=VALUE, not '" + std::string(pair) + "'",
                   std::string(name), known_keys(parameters)};
    const std::string_view key = pair.substr(0, equals);
    Setter setter(key, pair.substr(equals + 1));
    if (std::ranges::find(supplied, key) != supplied.end())
      return Error{ErrorKind::kBadInput, "`" + std::string(key) + "` is given twice", std::string(name), ""};
    supplied.push_back(key);
    visit_keys(parameters, setter);
    if (!setter.known)
      return Error{ErrorKind::kBadInput, std::string(base) + " has no key `" + std::string(key) + "`",
                   std::string(name), known_keys(parameters)};
    if (!setter.readable) return out_of_range(parameters, key);
  }
  if (const auto checked = check_phantom(parameters); !checked) return checked.error();
  return parameters;
}

std::string phantom_name(const PhantomParameters& parameters) {
  std::string name = base_name(parameters);
  const std::vector<Describer::Line> usual = written(mean_phantoms()[parameters.index()]);
  const std::vector<Describer::Line> lines = written(parameters);
  bool first = true;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (lines[i].values == usual[i].values) continue;
    name += (first ? ":" : ",") + lines[i].key + "=" + lines[i].values;
    first = false;
  }
  return name;
}

std::string phantom_keys() {
  std::string text;
  for (PhantomParameters parameters : mean_phantoms()) {
    Documenter documenter;
    visit_keys(parameters, documenter);
    text += (text.empty() ? "" : "\n") + ("### " + base_name(parameters)) +
            "\n\n| key | value | default | unit | range | meaning |\n|---|---|---|---|---|---|\n" +
            documenter.text;
  }
  return text;
}

}  // namespace palpate
