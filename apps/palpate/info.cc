#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iomanip>
#include <iostream>
#include <limits>
#include <numeric>
#include <sstream>

#include "apps/command/text.h"
#include "info.h"
#include "leak_text.h"
#include "palpate/base/reading.h"
#include "palpate/catalog/catalog.h"
#include "palpate/json/json.h"
#include "palpate/loading/loading.h"
#include "palpate/surfaces/surfaces.h"
#include "palpate/volume_io/volume_io.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

// result of `info` for a file
struct Info {
  VolumeHeader header;
  std::string evidence;  // reason for taking it as scan or labels; empty if that was stated
  double lowest = 0, highest = 0;
  std::optional<LabelFile> labels;  // empty for a scan
  std::vector<SegmentStatistics> statistics;
  std::vector<int> empty_slices;
  std::vector<Leaks> leaks;  // leaks of all labels
};

// --- labels or scan -------------------------------------------------------------------------------------

Result<Info> of_labels(LabelFile labels, Console& console) {
  Info info;
  info.header = labels.header;
  info.evidence = labels.evidence;
  info.lowest = std::numeric_limits<double>::infinity();
  for (const auto& layer : labels.labels.layers) {
    const auto [low, high] = std::minmax_element(layer.voxels().begin(), layer.voxels().end());
    info.lowest = std::min<double>(info.lowest, *low);
    info.highest = std::max<double>(info.highest, *high);
  }
  info.statistics = segment_statistics(labels.labels);
  info.empty_slices = empty_slices(labels.labels);
  std::vector<LabelId> all;
  for (const SegmentStatistics& s : info.statistics) all.push_back(s.id);
  auto leaks = find_leaks(*label_bricks(labels.labels.flattened()), all, 0, console.progress());
  if (!leaks) return leaks.error();
  info.leaks = *std::move(leaks);
  info.labels = std::move(labels);
  return info;
}

Info of_scan(const ScanFile& scan) {
  Info info;
  info.header = scan.header;
  info.evidence = scan.evidence;
  const auto [low, high] = std::minmax_element(scan.scan.voxels().begin(), scan.scan.voxels().end());
  info.lowest = *low;
  info.highest = *high;
  return info;
}

Result<Info> inspect(const InfoOptions& options, Console& console) {
  if (options.labels) {
    auto labels =
        read_labels(options.file, options.names, console.progress(), console.warn(), AmbiguousLabels::kWarn);
    return labels ? of_labels(*std::move(labels), console) : labels.error();
  }
  if (options.scan) {
    const auto scan =
        read_scan(options.file, console.progress(), console.warn(), VoxelCaching::kOff, options.volume);
    return scan ? Result<Info>(of_scan(*scan)) : scan.error();
  }
  auto volume = read_volume(options.file, options.names, console.progress(), console.warn(),
                            VoxelCaching::kOff, options.volume);
  if (!volume) return volume.error();
  if (auto* labels = std::get_if<LabelFile>(&*volume)) return of_labels(std::move(*labels), console);
  return of_scan(std::get<ScanFile>(*volume));
}

// --- words ----------------------------------------------------------------------------------------------

std::string number(double value, int digits = 6) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, value == 0 ? 0 : value);
  return text;
}

// 31195136 as "31 195 136"
std::string grouped(std::size_t count) {
  std::string text = std::to_string(count);
  for (int at = static_cast<int>(text.size()) - 3; at > 0; at -= 3)
    text.insert(static_cast<std::size_t>(at), " ");
  return text;
}

bool is_oblique(const Eigen::Matrix3d& direction) {
  return (direction.cwiseAbs().colwise().maxCoeff().array() < 1 - 1e-6).any();
}

Eigen::Vector3d extent_mm(const GridGeometry& g) {
  return {g.dims[0] * g.spacing_mm[0], g.dims[1] * g.spacing_mm[1], g.dims[2] * g.spacing_mm[2]};
}

std::string name_of(const Info& info, LabelId id) {
  const Segment* segment = info.labels->labels.find(id);
  return segment->name.empty() ? "label " + std::to_string(id) : segment->name;
}

// 0, 1, 2, 118 as "0-2, 118"
std::string ranges(const std::vector<int>& numbers) {
  std::string text;
  for (std::size_t n = 0; n < numbers.size();) {
    std::size_t last = n;
    while (last + 1 < numbers.size() && numbers[last + 1] == numbers[last] + 1) ++last;
    text += (text.empty() ? "" : ", ") + std::to_string(numbers[n]);
    if (last > n) text += "-" + std::to_string(numbers[last]);
    n = last + 1;
  }
  return text;
}

// "a, b, c", cut where it would fill the screen
std::string joined(const std::vector<std::string>& texts) {
  constexpr std::size_t kMaxListed = 24;
  std::string text;
  for (std::size_t n = 0; n < std::min(texts.size(), kMaxListed); ++n)
    text += (n == 0 ? "" : ", ") + texts[n];
  if (texts.size() > kMaxListed) text += " and " + std::to_string(texts.size() - kMaxListed) + " more";
  return text;
}

/// Irregularities that a user should know before trusting the file, one sentence each.
std::vector<std::string> oddities(const Info& info) {
  std::vector<std::string> odd;
  if (!info.header.has_geometry)
    odd.push_back(
        "the file does not state its orientation in the patient: its axes are taken as LPS, sides are "
        "unknown");
  if (!info.header.geometry.right_handed())
    odd.push_back("left-handed axes: software that ignores directions shows the mirror image");
  if (!info.labels) return odd;

  std::vector<std::string> unnamed, strays;
  for (const SegmentStatistics& s : info.statistics)
    if (info.labels->labels.find(s.id)->name.empty())
      unnamed.push_back(std::to_string(s.id) + " (" + std::to_string(s.voxels) + ")");

  // labels with the most stray voxels first
  const auto stray_voxels = [](const SegmentStatistics& s) { return s.voxels - s.largest_component_voxels; };
  std::vector<SegmentStatistics> by_strays = info.statistics;
  std::stable_sort(by_strays.begin(), by_strays.end(),
                   [&](const auto& a, const auto& b) { return stray_voxels(a) > stray_voxels(b); });
  for (const SegmentStatistics& s : by_strays)
    if (s.components > 1)
      strays.push_back(name_of(info, s.id) + " " + std::to_string(s.components - 1) + " (" +
                       std::to_string(stray_voxels(s)) + ")");

  if (unnamed.size() > 1 && unnamed.size() == info.statistics.size())
    odd.push_back("no label has a name: give names in a table (--names)");
  else if (!unnamed.empty())
    odd.push_back("without a name, with their voxels: " + joined(unnamed));
  for (const Segment& s : info.labels->labels.segments)
    if (std::none_of(info.statistics.begin(), info.statistics.end(),
                     [&](const auto& t) { return t.id == s.id; }))
      odd.push_back("segment " + std::to_string(s.id) + (s.name.empty() ? "" : " (" + s.name + ")") +
                    " has no voxels");
  if (!info.empty_slices.empty())
    odd.push_back(std::to_string(info.empty_slices.size()) + " of " +
                  std::to_string(info.header.geometry.dims[2]) +
                  " slices hold no label: " + ranges(info.empty_slices));
  if (!strays.empty())
    odd.push_back("in several parts, with the number and voxels of the parts other than the largest: " +
                  joined(strays));
  if (!info.leaks.empty())
    odd.push_back(describe_leaks(info.leaks, [&](LabelId id) { return name_of(info, id); }));
  return odd;
}

// --- text output ----------------------------------------------------------------------------------------

void print_geometry(std::ostream& out, const Info& info) {
  const GridGeometry& g = info.header.geometry;
  const Eigen::Vector3d extent = extent_mm(g);
  out << "format      " << info.header.format << ", " << info.header.component_type << ", "
      << (info.labels ? "labels" : "scan");
  if (info.header.layers > 1) out << " in " << info.header.layers << " layers";
  out << "\ndims        " << g.dims[0] << " x " << g.dims[1] << " x " << g.dims[2] << " ("
      << grouped(g.voxel_count()) << " voxels)\n"
      << "spacing     " << number(g.spacing_mm[0]) << " x " << number(g.spacing_mm[1]) << " x "
      << number(g.spacing_mm[2]) << " mm\n"
      << "extent      " << number(extent[0], 5) << " x " << number(extent[1], 5) << " x "
      << number(extent[2], 5) << " mm\n"
      << "origin      " << number(g.origin.x()) << ", " << number(g.origin.y()) << ", "
      << number(g.origin.z()) << " mm (LPS, centre of the first voxel)\n";
  for (int r = 0; r < 3; ++r) {
    char row[80];
    std::snprintf(row, sizeof row, "%9.6f %9.6f %9.6f", g.direction(r, 0), g.direction(r, 1),
                  g.direction(r, 2));
    out << (r == 0 ? "direction   " : "            ") << row << '\n';
  }
  out << "axes        " << axis_codes(g.direction) << (is_oblique(g.direction) ? ", oblique" : "")
      << (g.right_handed() ? ", right-handed" : ", left-handed") << '\n'
      << "values      " << number(info.lowest) << " ... " << number(info.highest) << '\n';
  if (info.labels && !info.labels->labels.segments.empty())
    print_wrapped(out, origin_of_names(*info.labels), "names       ", "            ");
  if (!info.evidence.empty())
    print_wrapped(out, info.evidence, std::string("kind        ") + (info.labels ? "labels: " : "scan: "),
                  "            ");
}

// prints a row of the table of labels
void print_row(std::ostream& out, const std::string& id, const std::string& name, std::size_t name_width,
               const std::string& voxels, const std::string& volume, const std::string& box,
               const std::string& components) {
  const auto right = [](const std::string& text, std::size_t width) {
    return std::string(width - std::min(width, text.size()), ' ') + text;
  };
  out << right(id, 5) << "  " << pad_or_truncate(name, name_width) << ' ' << right(voxels, 10) << ' '
      << right(volume, 11) << "  " << pad_or_truncate(box, 23) << ' ' << right(components, 10) << '\n';
}

std::string one_decimal(double value) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(1) << value;
  return text.str();
}

void print_labels(std::ostream& out, const Info& info) {
  std::size_t width = 4;
  for (const SegmentStatistics& s : info.statistics)
    width = std::max(width, display_width(info.labels->labels.find(s.id)->name));
  width = std::min<std::size_t>(width, 32);
  out << '\n' << info.statistics.size() << (info.statistics.size() == 1 ? " label\n" : " labels\n");
  if (info.statistics.empty()) return;
  print_row(out, "id", "name", width, "voxels", "mm3", "box i j k", "components");
  for (const SegmentStatistics& s : info.statistics) {
    std::string box;
    for (std::size_t a = 0; a < 3; ++a)
      box += (a == 0 ? "" : " ") + std::to_string(s.box_min[a]) + "-" + std::to_string(s.box_max[a]);
    const std::string& name = info.labels->labels.find(s.id)->name;
    print_row(out, std::to_string(s.id), name.empty() ? "-" : name, width, std::to_string(s.voxels),
              one_decimal(s.volume_mm3), box, std::to_string(s.components));
  }
}

void print_text(std::ostream& out, const Info& info) {
  print_geometry(out, info);
  if (info.labels) print_labels(out, info);
  const auto odd = oddities(info);
  if (odd.empty()) return;
  out << "\nodd\n";
  for (const std::string& sentence : odd) print_wrapped(out, sentence, "  - ", "    ");
}

// --- JSON output ----------------------------------------------------------------------------------------

// copy of an iterable as a vector
template <class Values>
std::vector<typename std::decay_t<decltype(*std::begin(std::declval<const Values&>()))>> list(
    const Values& values) {
  return {std::begin(values), std::end(values)};
}

Json label_json(const Segment& segment, const SegmentStatistics& s) {
  return {{"id", s.id},
          {"name", segment.name},
          {"layer", segment.layer},
          {"value", segment.value},
          {"colour", {segment.colour.r, segment.colour.g, segment.colour.b}},
          {"voxels", s.voxels},
          {"volume_mm3", s.volume_mm3},
          {"box_min", s.box_min},
          {"box_max", s.box_max},
          {"centroid_lps_mm", list(s.centroid.eigen())},
          {"components", s.components},
          {"largest_component_voxels", s.largest_component_voxels}};
}

Json json_of(const Info& info) {
  const GridGeometry& g = info.header.geometry;
  Json rows;
  for (int r = 0; r < 3; ++r) rows.push_back({g.direction(r, 0), g.direction(r, 1), g.direction(r, 2)});
  Json json{{"format", info.header.format},
            {"component_type", info.header.component_type},
            {"kind", info.labels ? "labels" : "scan"},
            {"evidence", info.evidence},
            {"layers", info.header.layers},
            {"dims", g.dims},
            {"spacing_mm", list(g.spacing_mm)},
            {"origin_lps_mm", list(g.origin.eigen())},
            {"direction_rows", rows},
            {"extent_mm", list(extent_mm(g))},
            {"axes", axis_codes(g.direction)},
            {"oblique", is_oblique(g.direction)},
            {"right_handed", g.right_handed()},
            {"has_geometry", info.header.has_geometry},
            {"placement_doubt", info.header.placement_doubt},
            {"range", {info.lowest, info.highest}}};
  if (info.labels) {
    json["leaky"] = Json::array();
    for (const Leaks& leaks : info.leaks)
      json["leaky"].push_back(
          {{"id", leaks.label}, {"places", leaks.joints}, {"one_lps_mm", list(leaks.position.eigen())}});
    json["empty_slices"] = info.empty_slices;
    json["unnamed"] = info.labels->unnamed;
    json["names_from"] = description_of(info.labels->name_source);
    if (info.labels->names_table) json["names_table"] = info.labels->names_table->string();
    json["labels"] = Json::array();
    for (const SegmentStatistics& s : info.statistics)
      json["labels"].push_back(label_json(*info.labels->labels.find(s.id), s));
  }
  json["odd"] = oddities(info);
  return json;
}

void print_json(std::ostream& out, const Info& info) {
  // bytes of names that are not UTF-8 are replaced
  out << json_of(info).dump(2) << '\n';
}

// --- the verb ------------------------------------------------------------------------------------------

// Lists all volumes; if exactly one is usable, it is described in full as well.
int run_info_of_dicom(const InfoOptions& options, Console& console) {
  const auto list = list_volumes(options.file, console.progress());
  if (!list) return console.fail(list.error());
  const auto usable =
      std::ranges::count_if(list->volumes, [](const auto& volume) { return volume.fault.empty(); });
  if (usable == 0) {
    options.json ? void(std::cout << volumes_json(*list).dump(2) << '\n') : print_volumes(std::cout, *list);
    return console.fail({ErrorKind::kBadInput, "holds no volume that can be used", options.file,
                         list->volumes.empty() ? "name a folder with a series of images"
                                               : "volume 1: " + list->volumes.front().remedy});
  }
  std::optional<Info> info;
  if (usable == 1) {
    auto inspected = inspect(options, console);
    if (!inspected) return console.fail(inspected.error());
    info = *std::move(inspected);
  }
  if (options.json) {
    Json json = volumes_json(*list);
    if (info) json.update(json_of(*info));
    std::cout << json.dump(2) << '\n';
    return kExitOk;
  }
  print_volumes(std::cout, *list);
  if (info) print_text(std::cout << '\n', *info);
  return kExitOk;
}

int run_info(const InfoOptions& options, Console& console) {
  if (options.keep_identifiers && !options.identifiers)
    return console.fail({ErrorKind::kUsage, "shows the values of identifiers and needs --identifiers",
                         "--keep-identifiers", "add --identifiers"});
  if (options.identifiers) return run_identifiers(options, console);
  if (find_entry(options.file).ok() || std::filesystem::path(options.file).extension() == ".toml")
    return run_info_of_scene(options, console);
  if (!options.volume && !options.labels && is_dicom(options.file))
    return run_info_of_dicom(options, console);
  const auto info = inspect(options, console);
  if (!info) return console.fail(info.error());
  options.json ? print_json(std::cout, *info) : print_text(std::cout, *info);
  return kExitOk;
}

}  // namespace

void add_info(CLI::App& app, Run& run) {
  CLI::App* verb = app.add_subcommand(
      "info",
      "Show the contents of a volume and anything unusual about it, or the memory that a scene needs");
  const auto options = std::make_shared<InfoOptions>();
  verb->add_option(
          "FILE", options->file,
          "NRRD, NIfTI, MetaImage or DICOM file, scan or labels, or a folder of DICOM; or a scene file "
          "or data set")
      ->required();
  add_volume_option(*verb, options->volume);
  add_names_option(*verb, options->names);
  verb->add_flag("-j,--json", options->json, "Print JSON instead of text");
  CLI::Option* labels = verb->add_flag("-l,--labels", options->labels, "Read the file as labels");
  verb->add_flag("-s,--scan", options->scan, "Read the file as a scan")->excludes(labels);
  verb->add_flag("--identifiers", options->identifiers,
                 "list the elements of DICOM files that identify the patient, by tag, without values");
  verb->add_flag("--keep-identifiers", options->keep_identifiers,
                 "with --identifiers: also show a value of each");
  verb->footer(
      "Examples:\n"
      "  palpate info knee.seg.nrrd\n"
      "  palpate info FOLDER --identifiers                    what to remove before sharing\n"
      "  palpate info labels.nii.gz --names dseg.tsv\n"
      "  palpate info FOLDER --volume 2                       second volume of DICOM files; without --volume "
      "they are listed\n"
      "  palpate info ct.nrrd --json | jq .spacing_mm\n"
      "  palpate info scene.toml                              memory that the scene needs");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return run_info(*options, console); }; });
}

}  // namespace palpate::app
