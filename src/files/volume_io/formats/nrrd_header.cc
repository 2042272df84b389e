#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <string_view>

#include "volume_io/formats/headers.h"
#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

// header lines, with field names in lower case
struct HeaderFields {
  std::map<std::string, std::string> fields;
  std::vector<std::pair<std::string, std::string>> segment_fields;
  std::size_t end = 0;
};

// key:=value pairs encode a line end as \n and double the backslash
std::string unescaped(std::string_view text) {
  std::string plain;
  for (std::size_t n = 0; n < text.size(); ++n) {
    if (text[n] == '\\' && n + 1 < text.size() && (text[n + 1] == 'n' || text[n + 1] == '\\'))
      plain.push_back(text[++n] == 'n' ? '\n' : '\\');
    else
      plain.push_back(text[n]);
  }
  return plain;
}

// fields of the format's definition (Gordon Kindlmann, teem.sourceforge.net/nrrd/format.html), without spaces
bool is_nrrd_field(std::string_view name) {
  static const std::set<std::string_view> kFields{
      "axismaxs",         "axismins",    "blocksize",  "byteskip",
      "centerings",       "centers",     "content",    "datafile",
      "dimension",        "encoding",    "endian",     "kinds",
      "labels",           "lineskip",    "max",        "min",
      "measurementframe", "number",      "oldmax",     "oldmin",
      "sampleunits",      "sizes",       "space",      "spacedimension",
      "spacedirections",  "spaceorigin", "spaceunits", "spacings",
      "thicknesses",      "type",        "units"};
  return kFields.contains(name);
}

Result<HeaderFields> split_lines(std::string_view bytes, const std::string& source) {
  HeaderFields lines;
  std::string_view remaining = bytes;
  if (read_line(remaining).substr(0, 5) != "NRRD0")
    return bad_input(source, "does not start with the NRRD magic", "is it really one, and complete?");
  for (int number = 2; !remaining.empty(); ++number) {
    const std::string_view line = read_line(remaining);
    if (line.empty()) break;
    if (line.front() == '#') continue;
    const auto colon = line.find(':');
    const std::string where = source + ":" + std::to_string(number);
    if (colon == std::string_view::npos)
      return bad_input(where, "is not a line of an NRRD header", "is the file complete?");

    if (line.substr(colon, 2) == ":=") {
      // only Slicer's key/value pairs are stored; others may identify a patient
      if (line.substr(0, 7) == "Segment")
        lines.segment_fields.emplace_back(std::string(trimmed(line.substr(0, colon))),
                                          unescaped(line.substr(colon + 2)));
      continue;
    }
    // "space origin" and "spaceorigin" are both common
    std::string name = lower_case(trimmed(line.substr(0, colon)));
    std::erase(name, ' ');
    // a misspelt field would be lost, and with it the place of the volume
    if (!is_nrrd_field(name))
      return bad_input(where, "has a field that NRRD does not define",
                       "correct its name, or write := after it");
    if (!lines.fields.emplace(name, std::string(trimmed(line.substr(colon + 1)))).second)
      return bad_input(where, "repeats a field of its header");
  }
  lines.end = bytes.size() - remaining.size();
  return lines;
}

std::optional<Component> parse_type(const std::string& name) {
  static const std::map<std::string, Component> kTypes{{"signed char", Component::kInt8},
                                                       {"int8", Component::kInt8},
                                                       {"int8_t", Component::kInt8},
                                                       {"uchar", Component::kUint8},
                                                       {"unsigned char", Component::kUint8},
                                                       {"uint8", Component::kUint8},
                                                       {"uint8_t", Component::kUint8},
                                                       {"short", Component::kInt16},
                                                       {"short int", Component::kInt16},
                                                       {"signed short", Component::kInt16},
                                                       {"signed short int", Component::kInt16},
                                                       {"int16", Component::kInt16},
                                                       {"int16_t", Component::kInt16},
                                                       {"ushort", Component::kUint16},
                                                       {"unsigned short", Component::kUint16},
                                                       {"unsigned short int", Component::kUint16},
                                                       {"uint16", Component::kUint16},
                                                       {"uint16_t", Component::kUint16},
                                                       {"int", Component::kInt32},
                                                       {"signed int", Component::kInt32},
                                                       {"int32", Component::kInt32},
                                                       {"int32_t", Component::kInt32},
                                                       {"uint", Component::kUint32},
                                                       {"unsigned int", Component::kUint32},
                                                       {"uint32", Component::kUint32},
                                                       {"uint32_t", Component::kUint32},
                                                       {"longlong", Component::kInt64},
                                                       {"long long", Component::kInt64},
                                                       {"long long int", Component::kInt64},
                                                       {"signed long long", Component::kInt64},
                                                       {"signed long long int", Component::kInt64},
                                                       {"int64", Component::kInt64},
                                                       {"int64_t", Component::kInt64},
                                                       {"ulonglong", Component::kUint64},
                                                       {"unsigned long long", Component::kUint64},
                                                       {"unsigned long long int", Component::kUint64},
                                                       {"uint64", Component::kUint64},
                                                       {"uint64_t", Component::kUint64},
                                                       {"float", Component::kFloat32},
                                                       {"double", Component::kFloat64}};
  const auto found = kTypes.find(lower_case(name));
  return found == kTypes.end() ? std::nullopt : std::optional(found->second);
}

std::optional<Encoding> parse_encoding(const std::string& name) {
  const std::string lower = lower_case(name);
  if (lower == "raw") return Encoding::kRaw;
  if (lower == "gzip" || lower == "gz") return Encoding::kDeflate;
  if (lower == "bzip2" || lower == "bz2") return Encoding::kBzip2;
  if (lower == "text" || lower == "txt" || lower == "ascii") return Encoding::kText;
  if (lower == "hex") return Encoding::kHex;
  return std::nullopt;
}

// "(a,b,c)" or "none" for each axis; nullopt for any other text
using AxisVector = std::optional<std::vector<double>>;
std::optional<std::vector<AxisVector>> parse_vectors(std::string_view text) {
  std::vector<AxisVector> vectors;
  for (text = trimmed(text); !text.empty(); text = trimmed(text)) {
    if (lower_case(text.substr(0, 4)) == "none") {
      vectors.emplace_back();
      text.remove_prefix(4);
      continue;
    }
    const auto end = text.find(')');
    if (text.front() != '(' || end == std::string_view::npos) return std::nullopt;
    std::vector<double> numbers;
    for (const std::string_view part : split_at(text.substr(1, end - 1), ',')) {
      const auto number = parse_number<double>(trimmed(part));
      if (!number || !std::isfinite(*number)) return std::nullopt;
      numbers.push_back(*number);
    }
    vectors.emplace_back(std::move(numbers));
    text.remove_prefix(end + 1);
  }
  return vectors;
}

class Parser {
 public:
  Parser(HeaderFields lines, const std::string& source) : lines_(std::move(lines)), source_(source) {}

  Result<NrrdHeader> parse() {
    using Step = Result<void> (Parser::*)();
    for (const Step step : {&Parser::parse_axes, &Parser::remove_layer_axis, &Parser::parse_geometry,
                            &Parser::parse_value_type, &Parser::parse_offsets})
      if (auto done = (this->*step)(); !done) return done.error();
    header_.segment_fields = std::move(lines_.segment_fields);
    header_.voxels.offset = lines_.end;
    return std::move(header_);
  }

 private:
  // text of a field, or nullptr
  const std::string* field(const char* name, const char* other = "") const {
    auto found = lines_.fields.find(name);
    if (found == lines_.fields.end()) found = lines_.fields.find(other);
    return found == lines_.fields.end() ? nullptr : &found->second;
  }
  Error bad(std::string what, std::string remedy = "") const {
    return bad_input(source_, std::move(what), std::move(remedy));
  }

  Result<void> parse_axes() {
    const std::string* dimension = field("dimension");
    const std::string* sizes = field("sizes");
    if (dimension == nullptr || sizes == nullptr) return bad("its header lacks the dimension or the sizes");
    for (const std::string_view text : split_spaces(*sizes)) {
      const auto size = parse_number<std::int64_t>(text);
      if (!size) return bad("a size in its header is not a whole number");
      header_.axes.push_back(*size);
    }
    const auto count = parse_number<std::uint32_t>(*dimension);
    if (!count || *count != header_.axes.size() || *count == 0 || *count > 16)
      return bad("its dimension does not agree with its sizes");
    return {};
  }

  // removes the layer axis (several values per voxel) from the spatial axes
  Result<void> remove_layer_axis() {
    const std::string* kinds = field("kinds");
    if (kinds == nullptr) return {};
    const auto names = split_spaces(*kinds);
    if (names.size() != header_.axes.size()) return bad("its kinds do not agree with its dimension");
    static constexpr std::array<std::string_view, 5> kScalarAxisKinds{"domain", "space", "time", "none",
                                                                      "???"};
    for (std::size_t a = 0; a < names.size(); ++a) {
      if (std::ranges::find(kScalarAxisKinds, lower_case(names[a])) != kScalarAxisKinds.end()) continue;
      if (header_.has_layer_axis || (a != 0 && a + 1 != names.size()))
        return bad("holds several values for each voxel in an unsupported layout",
                   "give one value for each voxel, or segmentation layers as the first axis");
      header_.has_layer_axis = true;
      layer_axis_index_ = a;
    }
    if (!header_.has_layer_axis) return {};
    const std::int64_t layers = header_.axes[layer_axis_index_];
    if (layers < 1 || layers > 4096) return bad("has " + std::to_string(layers) + " layers");
    header_.layers = static_cast<int>(layers);
    header_.layers_first = layer_axis_index_ == 0;
    header_.axes.erase(header_.axes.begin() + static_cast<std::ptrdiff_t>(layer_axis_index_));
    return {};
  }

  Result<void> parse_geometry() {
    if (const std::string* spacings = field("spacings")) {
      const auto parts = split_spaces(*spacings);
      if (parts.size() != header_.axes.size() + header_.has_layer_axis)
        return bad("its spacings do not agree with its dimension");
      for (std::size_t a = 0; a < parts.size(); ++a) {
        if (header_.has_layer_axis && a == layer_axis_index_) continue;
        const auto spacing = parse_number<double>(parts[a]);
        if (!spacing || !std::isfinite(*spacing) || *spacing <= 0)
          return bad("the spacing of axis " + std::to_string(a + 1) + " is not a positive number");
      }
    }
    if (const std::string* units = field("spaceunits")) {
      for (const std::string_view unit : split_spaces(*units))
        if (unit != "\"mm\"" && unit != "\"\"" && unit != "\"millimeter\"" && unit != "\"millimeters\"")
          return bad("its lengths are in " + std::string(unit.substr(0, 20)) +
                         ", but only millimetres are supported",
                     "convert it to millimetres");
    }
    return parse_space_and_origin();
  }

  // dimension of the space that the header names; 0: it names none
  Result<std::size_t> parse_space_dimension() {
    const std::string* name = field("space");
    const std::string* dimension = field("spacedimension");
    if (name != nullptr && dimension != nullptr) return bad("states both a space and a space dimension");
    if (dimension != nullptr) {
      const auto count = parse_number<std::uint8_t>(*dimension);
      if (!count || *count == 0 || *count > 8) return bad("its space dimension is not a number in 1 ... 8");
      return std::size_t{*count};
    }
    if (name == nullptr) return std::size_t{0};
    space_ = lower_case(*name);
    std::erase_if(space_, [](char c) { return c == '-' || c == ' '; });
    static const std::map<std::string_view, std::size_t> kDimensions{{"rightanteriorsuperior", 3},
                                                                     {"ras", 3},
                                                                     {"leftanteriorsuperior", 3},
                                                                     {"las", 3},
                                                                     {"leftposteriorsuperior", 3},
                                                                     {"lps", 3},
                                                                     {"scannerxyz", 3},
                                                                     {"3drighthanded", 3},
                                                                     {"3dlefthanded", 3},
                                                                     {"rast", 4},
                                                                     {"rightanteriorsuperiortime", 4},
                                                                     {"last", 4},
                                                                     {"leftanteriorsuperiortime", 4},
                                                                     {"lpst", 4},
                                                                     {"leftposteriorsuperiortime", 4},
                                                                     {"scannerxyztime", 4},
                                                                     {"3drighthandedtime", 4},
                                                                     {"3dlefthandedtime", 4}};
    const auto known = kDimensions.find(space_);
    if (known == kDimensions.end())
      return bad("its space '" + name->substr(0, 40) + "' is none of NRRD", "use left-posterior-superior");
    return known->second;
  }

  // sign of each axis of the header's space in LPS
  Eigen::Vector3d to_lps() const {
    if (space_ == "ras" || space_ == "rightanteriorsuperior") return {-1, -1, 1};
    if (space_ == "las" || space_ == "leftanteriorsuperior") return {1, -1, 1};
    return Eigen::Vector3d::Ones();
  }

  Result<void> parse_space_and_origin() {
    const auto dimension = parse_space_dimension();
    if (!dimension) return dimension.error();
    const std::string* text = field("spacedirections");
    const std::string* origin = field("spaceorigin");
    if (*dimension == 0) {
      if (text != nullptr || origin != nullptr)
        return bad("states space directions or a space origin, but not in which space",
                   "add 'space: left-posterior-superior', if that is what they are in");
      return parse_axes_without_space();
    }
    if (field("spacings") != nullptr)
      return bad("states both spacings and a space", "keep the space directions, and remove the spacings");
    if (text != nullptr)
      if (auto parsed = parse_directions(*text, *dimension); !parsed) return parsed;
    if (*dimension != header_.axes.size())
      return bad("its space has " + std::to_string(*dimension) + " dimensions, but its voxels have " +
                 std::to_string(header_.axes.size()));
    if (origin != nullptr) {
      const auto point = parse_vectors(*origin);
      if (!point || point->size() != 1 || (point->front() && point->front()->size() != *dimension))
        return bad("its space origin is not one finite point");
      if (point->front())
        for (std::size_t a = 0; a < std::min<std::size_t>(3, *dimension); ++a)
          header_.geometry.origin_mm[static_cast<int>(a)] =
              to_lps()[static_cast<int>(a)] * (*point->front())[a];
    }
    header_.has_geometry =
        text != nullptr && *dimension == 3 &&
        (space_ == "leftposteriorsuperior" || space_ == "lps" || space_ == "ras" ||
         space_ == "rightanteriorsuperior" || space_ == "las" || space_ == "leftanteriorsuperior");
    return {};
  }

  Result<void> parse_directions(const std::string& text, std::size_t dimension) {
    const auto vectors = parse_vectors(text);
    if (!vectors || vectors->size() != header_.axes.size() + header_.has_layer_axis)
      return bad("its space directions are not one finite vector for each axis");
    int axis = 0;
    for (std::size_t a = 0; a < vectors->size(); ++a) {
      const AxisVector& vector = (*vectors)[a];
      const bool is_spatial = !(header_.has_layer_axis && a == layer_axis_index_);
      if (!vector && !is_spatial) continue;
      if (!vector)
        return bad("axis " + std::to_string(a + 1) + " has no space direction",
                   "give one volume of three axes that all have one");
      if (vector->size() != dimension)
        return bad("the space direction of axis " + std::to_string(a + 1) + " has " +
                   std::to_string(vector->size()) + " numbers, but its space has " +
                   std::to_string(dimension) + " dimensions");
      if (!is_spatial) continue;
      // in the order of teem's arithmetic, for the same rounding
      double square = 0;
      for (const double number : *vector) square += number * number;
      const double length = std::sqrt(square), scale = 1.0 / length;
      if (axis < 3) {
        header_.geometry.spacing_mm[axis] = length;
        for (std::size_t r = 0; r < std::min<std::size_t>(3, dimension); ++r)
          header_.geometry.direction(static_cast<int>(r), axis) =
              to_lps()[static_cast<int>(r)] * (scale * (*vector)[r]);
        ++axis;
      }
    }
    return {};
  }

  // numbers of a field with one for each axis, without the layer axis; NaN where there is none
  Result<std::vector<double>> axis_numbers(const char* name, const char* shown) const {
    std::vector<double> numbers;
    if (const std::string* text = field(name)) {
      const auto parts = split_spaces(*text);
      if (parts.size() != header_.axes.size() + header_.has_layer_axis)
        return bad(std::string("its ") + shown + " do not agree with its dimension");
      for (std::size_t a = 0; a < parts.size(); ++a) {
        if (header_.has_layer_axis && a == layer_axis_index_) continue;
        const auto number = parse_number<double>(parts[a]);
        if (!number) return bad(std::string("its ") + shown + " are not a number for each axis");
        numbers.push_back(*number);
      }
    }
    numbers.resize(header_.axes.size(), std::numeric_limits<double>::quiet_NaN());
    return numbers;
  }

  // Geometry by spacings and the positions at which the axes begin, whose directions are taken as LPS. Where
  // the spacings are not stated, they are 1 mm as in ITK, which derives the origin from the ends of the axes.
  Result<void> parse_axes_without_space() {
    const auto spacings = axis_numbers("spacings", "spacings"),
               begins = axis_numbers("axismins", "axis mins"), ends = axis_numbers("axismaxs", "axis maxs");
    if (!spacings) return spacings.error();
    if (!begins) return begins.error();
    if (!ends) return ends.error();
    const auto is_unknown = [](double number) { return std::isnan(number); };
    // ITK would drop all positions, or read NaN, depending on which one is missing
    if (!std::ranges::all_of(*begins, is_unknown) && std::ranges::any_of(*begins, is_unknown))
      return bad("its axis mins are known for some axes only", "state all of them, or none");
    const auto is_infinite = [](double number) { return std::isinf(number); };
    if (std::ranges::any_of(*begins, is_infinite) || std::ranges::any_of(*ends, is_infinite))
      return bad("its axis mins or axis maxs are not finite numbers");
    const std::size_t count = std::min<std::size_t>(3, header_.axes.size());
    for (std::size_t a = 0; a < count; ++a)
      if (std::isfinite((*spacings)[a])) header_.geometry.spacing_mm[static_cast<int>(a)] = (*spacings)[a];
    const bool has_spacings = std::ranges::none_of(*spacings, is_unknown);
    if (std::ranges::any_of(*begins, is_unknown) || (!has_spacings && std::ranges::any_of(*ends, is_unknown)))
      return {};
    // an axis begins at the border of its first voxel, unless its values are stated to lie at nodes
    std::vector<std::string_view> centers;
    for (const char* name : {"centers", "centerings"})
      if (const std::string* text = field(name)) centers = split_spaces(*text);
    if (header_.has_layer_axis && layer_axis_index_ < centers.size())
      centers.erase(centers.begin() + static_cast<std::ptrdiff_t>(layer_axis_index_));
    for (std::size_t a = 0; a < count; ++a) {
      const bool at_nodes = a < centers.size() && lower_case(centers[a]) == "node";
      const double voxel_mm =
          has_spacings ? (*spacings)[a] : ((*ends)[a] - (*begins)[a]) / static_cast<double>(header_.axes[a]);
      header_.geometry.origin_mm[static_cast<int>(a)] = (*begins)[a] + (at_nodes ? 0 : voxel_mm / 2);
    }
    return {};
  }

  Result<void> parse_value_type() {
    const std::string* type = field("type");
    const std::string* encoding = field("encoding");
    if (type == nullptr || encoding == nullptr) return bad("its header lacks the type or the encoding");
    const auto component = parse_type(*type);
    if (!component) return bad("its type '" + type->substr(0, 30) + "' is not a supported number type");
    const auto how = parse_encoding(*encoding);
    if (!how)
      return bad("its encoding '" + encoding->substr(0, 30) + "' is not supported",
                 "save it with gzip encoding");
    header_.voxels.component = *component;
    header_.voxels.encoding = *how;

    const std::string* endian = field("endian");
    if (endian != nullptr && lower_case(*endian) != "little" && lower_case(*endian) != "big")
      return bad("its endian is neither little nor big");
    if (endian == nullptr && *how != Encoding::kText && bytes_of(*component) > 1)
      return bad("its header lacks the endian", "add 'endian: little' or 'endian: big'");
    header_.voxels.big_endian = endian != nullptr && lower_case(*endian) == "big";
    return {};
  }

  Result<void> parse_offsets() {
    if (const std::string* name = field("datafile")) {
      if (lower_case(name->substr(0, 4)) == "list" || name->find('%') != std::string::npos)
        return bad("its voxels are spread over several files", "save it as one file");
      if (name->empty()) return bad("names an empty data file");
      header_.data_file = *name;
    }
    if (const std::string* text = field("lineskip")) {
      const auto skip = parse_number<std::uint16_t>(*text);
      if (!skip) return bad("its line skip is not a whole number in 0 ... 65535");
      header_.line_skip = *skip;
    }
    if (const std::string* text = field("byteskip")) {
      const auto skip = parse_number<std::int64_t>(*text);
      if (!skip || *skip > (std::int64_t{1} << 40) || *skip < -(std::int64_t{1} << 40))
        return bad("its byte skip is not a number of bytes");
      // -1: the voxels end at the end of the file; -5: they end 4 bytes before it
      if (*skip < 0)
        header_.voxels.trailing_bytes = static_cast<std::uint64_t>(-(*skip + 1));
      else
        header_.voxels.skip = static_cast<std::uint64_t>(*skip);
      const bool text_numbers =
          header_.voxels.encoding == Encoding::kText || header_.voxels.encoding == Encoding::kHex;
      if (text_numbers && *skip != 0) return bad("has a byte skip before voxels written as text");
    }
    return {};
  }

  HeaderFields lines_;
  const std::string& source_;
  NrrdHeader header_;
  std::size_t layer_axis_index_ = 0;
  std::string space_;  // in lower case, without hyphens
};

}  // namespace

Result<NrrdHeader> parse_nrrd_header(std::string_view bytes, const std::string& source) {
  auto lines = split_lines(bytes, source);
  if (!lines) return lines.error();
  return Parser(std::move(*lines), source).parse();
}

}  // namespace palpate::volume_io
