#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <set>

#include "palpate/base/printable.h"
#include "palpate/indentation/indentation.h"

namespace palpate {
namespace {

enum Column { kDepth, kForce, kTime, kCurve, kRadius, kThickness, kBase, kPreset, kColumns };
constexpr std::array<std::string_view, kColumns> kNames{"depth_mm",  "force_N",      "time_s", "curve",
                                                        "radius_mm", "thickness_mm", "base",   "preset"};

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\r");
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

std::vector<std::string_view> fields_of(std::string_view line) {
  std::vector<std::string_view> fields;
  for (std::size_t begin = 0; begin <= line.size();) {
    const std::size_t end = std::min(line.find(',', begin), line.size());
    std::string_view field = trimmed(line.substr(begin, end - begin));
    if (field.size() >= 2 && field.front() == '"' && field.back() == '"')
      field = field.substr(1, field.size() - 2);
    fields.push_back(field);
    begin = end + 1;
  }
  return fields;
}

std::optional<double> number_of(std::string_view text) {
  double value = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), value);
  if (read.ec != std::errc() || read.ptr != text.data() + text.size() || !std::isfinite(value)) return {};
  return value;
}

std::optional<SpecimenBase> base_of(std::string_view text) {
  if (text == "thick") return SpecimenBase::kThick;
  if (text == "bonded") return SpecimenBase::kBonded;
  if (text == "sliding") return SpecimenBase::kSliding;
  return {};
}

class Reader {
 public:
  Reader(const CurveDefaults& defaults, const std::string& source) : defaults_(defaults), source_(source) {}

  Result<std::vector<IndentationCurve>> read(std::string_view text) {
    if (text.size() > kMaxCurveBytes)
      return Error{ErrorKind::kBadInput, "is larger than 64 MiB", source_, "give fewer curves"};
    for (line_ = 1; !text.empty(); ++line_) {
      const std::size_t end = text.find('\n');
      const std::string_view line = trimmed(text.substr(0, end));
      text.remove_prefix(end == text.npos ? text.size() : end + 1);
      if (line.empty() || line.front() == '#') continue;
      const auto read = columns_.empty() ? header(fields_of(line)) : sample(fields_of(line));
      if (!read) return read.error();
    }
    if (curves_.empty())
      return Error{ErrorKind::kBadInput, "holds no sample", source_,
                   "the first line names the columns, at least depth_mm,force_N"};
    return std::move(curves_);
  }

 private:
  Error error(std::string what, std::string remedy) const {
    return {ErrorKind::kBadInput, std::move(what), source_ + ":" + std::to_string(line_), std::move(remedy)};
  }

  Result<void> header(const std::vector<std::string_view>& names) {
    for (const std::string_view name : names) {
      const auto column = static_cast<Column>(std::ranges::find(kNames, name) - kNames.begin());
      if (column == kColumns)
        return error("unknown column \"" + printable_name(std::string(name)) + "\"",
                     "columns: depth_mm, force_N, time_s, curve, radius_mm, thickness_mm, base, preset");
      if (std::ranges::find(columns_, column) != columns_.end())
        return error("two columns \"" + std::string(name) + "\"", "leave one out");
      columns_.push_back(column);
    }
    for (const Column needed : {kDepth, kForce})
      if (std::ranges::find(columns_, needed) == columns_.end())
        return error("no column " + std::string(kNames[needed]),
                     "the first line names the columns, at least depth_mm,force_N");
    return {};
  }

  Result<void> sample(const std::vector<std::string_view>& fields) {
    if (fields.size() != columns_.size())
      return error(
          std::to_string(fields.size()) + " fields for " + std::to_string(columns_.size()) + " columns",
          "give every line a field for each column");
    if (++samples_ > kMaxCurveSamples)
      return error("more than " + std::to_string(kMaxCurveSamples) + " samples",
                   "give fewer, or several files");
    std::array<std::string_view, kColumns> by_column{};
    for (std::size_t n = 0; n < fields.size(); ++n) by_column[columns_[n]] = fields[n];
    if (curves_.empty() || by_column[kCurve] != curves_.back().name)
      if (auto begun = begin_curve(by_column); !begun) return begun;
    IndentationCurve& curve = curves_.back();
    for (const auto& [column, values] :
         {std::pair(kDepth, &curve.depth_mm), std::pair(kForce, &curve.force_N),
          std::pair(kTime, &curve.time_s)}) {
      if (column == kTime && !has(kTime)) continue;
      const auto value = number_of(by_column[column]);
      if (!value)
        return error(std::string(kNames[column]) + " is \"" + printable_name(std::string(by_column[column])) +
                         "\", not a number",
                     "write numbers with a decimal point, without units");
      values->push_back(*value);
    }
    if (curve.time_s.size() > 1 && !(curve.time_s.back() > curve.time_s[curve.time_s.size() - 2]))
      return error("time_s does not increase", "give the samples of a curve in the order of time");
    return {};
  }

  Result<void> begin_curve(const std::array<std::string_view, kColumns>& by_column) {
    const std::string name(by_column[kCurve]);
    if (!names_.insert(name).second)
      return error("the curve \"" + printable_name(name) + "\" begins again",
                   "give all samples of a curve one after the other");
    if (curves_.size() == kMaxCurves)
      return error("more than " + std::to_string(kMaxCurves) + " curves", "give several files");
    IndentationCurve curve;
    curve.name = name;
    curve.preset = has(kPreset) ? std::string(by_column[kPreset]) : defaults_.preset;
    const auto length = [&](Column column, const std::optional<double>& fallback,
                            double& value) -> Result<bool> {
      if (!has(column) || by_column[column].empty()) {
        if (fallback) value = *fallback;
        return fallback.has_value();
      }
      const auto read = number_of(by_column[column]);
      constexpr double kMax_mm = 1000;
      if (!read || !(*read > 0 && *read <= kMax_mm))
        return error(
            std::string(kNames[column]) + " is \"" + printable_name(std::string(by_column[column])) + "\"",
            "give a length in millimetres, above 0");
      value = *read;
      return true;
    };
    const auto radius = length(kRadius, defaults_.radius_mm, curve.setup.radius_mm);
    if (!radius) return radius.error();
    if (!*radius)
      return error("the radius of the indenter is not given", "add --radius 4, in mm, or a column radius_mm");
    const auto thickness = length(kThickness, defaults_.thickness_mm, curve.setup.thickness_mm);
    if (!thickness) return thickness.error();
    std::optional<SpecimenBase> base = defaults_.base;
    if (has(kBase) && !by_column[kBase].empty()) {
      base = base_of(by_column[kBase]);
      if (!base)
        return error("base is \"" + printable_name(std::string(by_column[kBase])) + "\"",
                     "give thick, bonded or sliding");
    }
    if (!base && !*thickness) base = SpecimenBase::kThick;
    if (!base)
      return error("a thickness is given, but not what the specimen lies on",
                   "add --base bonded or sliding, or a column base; thick: it is too thick to matter");
    if (*base != SpecimenBase::kThick && !*thickness)
      return error("a base is given, but not the thickness of the specimen",
                   "add --thickness 10, in mm, or a column thickness_mm");
    curve.setup.base = *base;
    curves_.push_back(std::move(curve));
    return {};
  }

  bool has(Column column) const { return std::ranges::find(columns_, column) != columns_.end(); }

  const CurveDefaults& defaults_;
  const std::string& source_;
  int line_ = 0;
  std::size_t samples_ = 0;
  std::vector<Column> columns_;
  std::set<std::string> names_;
  std::vector<IndentationCurve> curves_;
};

}  // namespace

Result<std::vector<IndentationCurve>> read_indentation_curves(std::string_view text,
                                                              const CurveDefaults& defaults,
                                                              const std::string& source) {
  return Reader(defaults, source).read(text);
}

}  // namespace palpate
