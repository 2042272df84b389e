#include "palpate/lint/lint.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <limits>
#include <memory>
#include <optional>

#include "apps/command/text.h"
#include "input_files.h"
#include "palpate/base/file.h"
#include "palpate/base/output.h"
#include "palpate/base/printable.h"
#include "palpate/contact/model.h"
#include "palpate/json/json.h"
#include "palpate/loading/loading.h"
#include "palpate/rendering/rendering.h"
#include "palpate/report/lint_page.h"
#include "palpate/scene/tissue_presets.h"
#include "palpate/volume/resample.h"
#include "palpate/volume_io/volume_io.h"
#include "palpate_version.h"
#include "scene_options.h"
#include "verb.h"

namespace palpate::app {
namespace {

namespace fs = std::filesystem;

// the check accepts the tool radius of any scene
static_assert(kMaxLintToolRadius_mm == kMaxToolRadius_mm);

struct LintVerbOptions {
  SceneSource source;
  double tool_radius_mm = LintOptions{}.tool_radius_mm;
  std::optional<std::string> json;  ///< File; "-": standard output
  std::optional<fs::path> page, fix;
};

/// Whether a structure of that name is too stiff for a tool to pass through; empty: unknown. Presets without
/// a modulus (bone, joint cartilage) do not deform.
std::optional<bool> is_hard_by_name(const std::string& name) {
  const PresetMatch match = match_preset(name);
  if (match.is_hollow) return false;
  if (match.preset == nullptr) return std::nullopt;
  return match.preset->values.touchable && !match.preset->values.elastic;
}

// --- outputs --------------------------------------------------------------------------------------------

struct NamedOutput {
  const char* option;
  fs::path file;
};

/// Claims all output files. Errors: those of claim_output, and two outputs to one file.
Result<std::vector<OutputClaim>> claim_outputs(const LintVerbOptions& options) {
  const std::vector<fs::path> inputs = input_files(options.source);
  std::vector<NamedOutput> outputs;
  if (options.json && *options.json != "-") outputs.push_back({"--json", *options.json});
  if (options.page) outputs.push_back({"--page", *options.page});
  if (options.fix) outputs.push_back({"--fix", *options.fix});
  std::vector<OutputClaim> claims;
  for (std::size_t n = 0; n < outputs.size(); ++n) {
    for (std::size_t m = 0; m < n; ++m)
      if (same_file(outputs[n].file, outputs[m].file))
        return Error{ErrorKind::kUsage,
                     std::string("is written by ") + outputs[m].option + " and by " + outputs[n].option,
                     outputs[n].file.string(), "give each output a different file"};
    auto claimed = claim_output(outputs[n].file, inputs);
    if (!claimed) return claimed.error();
    claims.push_back(*std::move(claimed));
  }
  return claims;
}

// --- words ----------------------------------------------------------------------------------------------

std::string count_of(std::size_t count, const char* noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

std::string position_text(const LintFinding& finding) {
  if (!finding.position) return "";
  char text[120];
  std::snprintf(text, sizeof text, "%.1f, %.1f, %.1f mm LPS (voxel %d %d %d)", finding.position->x(),
                finding.position->y(), finding.position->z(), finding.voxel[0], finding.voxel[1],
                finding.voxel[2]);
  return text;
}

void print_report(std::ostream& out, const LintReport& report) {
  constexpr std::size_t kLinesOfAKind = 6, kMaxStructures = 60;
  out << "grade " << report.grade << ": " << count_of(report.count(LintSeverity::kFault), "fault") << ", "
      << count_of(report.count(LintSeverity::kWarning), "warning") << ", "
      << report.count(LintSeverity::kUndetermined) << " that cannot be decided, in "
      << count_of(report.structures.size(), "structure") << '\n';
  std::size_t clean = 0, shown = 0;
  for (const StructureGrade& structure : report.structures) {
    if (structure.grade == 'A') {
      ++clean;
      continue;
    }
    if (++shown > kMaxStructures) continue;
    out << "  " << structure.grade << "  " << printable_name(structure.name) << '\n';
  }
  if (shown > kMaxStructures) out << "     and " << shown - kMaxStructures << " more\n";
  if (clean > 0 && shown > 0)
    out << "  A  " << (clean == 1 ? "the other one" : "the other " + std::to_string(clean)) << '\n';

  for (std::size_t n = 0; n < report.findings.size();) {
    const LintFinding& first = report.findings[n];
    const LintKindInfo& kind = lint_kind(first.kind);
    out << '\n' << in_words(first.severity) << ": " << kind.title << '\n';
    if (first.severity != LintSeverity::kUndetermined)
      print_wrapped(out, std::string(kind.effect) + "; remedy: " + std::string(kind.remedy), "  ", "  ");
    std::size_t lines = 0, end = n;
    for (; end < report.findings.size() && report.findings[end].kind == first.kind &&
           report.findings[end].severity == first.severity;
         ++end) {
      if (++lines > kLinesOfAKind) continue;
      const LintFinding& finding = report.findings[end];
      print_wrapped(out,
                    printable_name(finding.sentence) +
                        (finding.position ? ", at " + position_text(finding) : std::string()),
                    "  - ", "    ");
    }
    if (lines > kLinesOfAKind) out << "  - and " << lines - kLinesOfAKind << " more\n";
    n = end;
  }
}

// --- JSON output ----------------------------------------------------------------------------------------

Json lint_json(const LintReport& report, const LintVerbOptions& options, const LabelMap& labels,
               const std::vector<LintRepair>& repairs) {
  Json json{{"grade", std::string(1, report.grade)},
            {"tool_radius_mm", options.tool_radius_mm},
            {"faults", report.count(LintSeverity::kFault)},
            {"warnings", report.count(LintSeverity::kWarning)},
            {"cannot_tell", report.count(LintSeverity::kUndetermined)}};
  Json structures = Json::array(), findings = Json::array(), kinds = Json::array();
  for (const StructureGrade& s : report.structures)
    structures.push_back({{"id", s.id},
                          {"name", labels.find(s.id)->name},
                          {"grade", std::string(1, s.grade)},
                          {"voxels", s.voxels},
                          {"volume_mm3", s.volume_mm3},
                          {"faults", s.faults},
                          {"warnings", s.warnings},
                          {"cannot_tell", s.undecided}});
  for (const LintFinding& finding : report.findings) {
    const LintKindInfo& kind = lint_kind(finding.kind);
    Json one{{"kind", kind.key},
             {"severity", in_words(finding.severity)},
             {"structures", finding.structures},
             {"quantity", finding.quantity},
             {"unit", finding.unit},
             {"voxels", finding.voxels},
             {"sentence", finding.sentence},
             {"effect", kind.effect},
             {"remedy", kind.remedy}};
    if (finding.position) {
      one["place_lps_mm"] = std::array{finding.position->x(), finding.position->y(), finding.position->z()};
      one["voxel"] = finding.voxel;
    }
    findings.push_back(std::move(one));
  }
  for (const LintKindInfo& kind : lint_kinds())
    kinds.push_back({{"kind", kind.key}, {"title", kind.title}, {"definition", kind.definition}});
  json["structures"] = std::move(structures);
  json["findings"] = std::move(findings);
  json["kinds"] = std::move(kinds);
  if (options.fix) {
    json["mended"] = Json::array();
    for (const LintRepair& repair : repairs)
      json["mended"].push_back({{"kind", lint_kind(repair.kind).key},
                                {"structure", repair.structure},
                                {"parts", repair.parts},
                                {"voxels", repair.voxels},
                                {"name", repair.name}});
  }
  return json;
}

// --- the page -------------------------------------------------------------------------------------------

/// Model with labels and scan only, which is sufficient for drawing sections without preparation.
Model model_to_draw(const SceneVolumes& volumes, const Volume<float>* scan_on_grid) {
  Model model;
  model.labels = label_bricks(volumes.labels->flattened());
  model.segments = volumes.labels->segments;
  model.oriented = volumes.oriented;
  model.side = Side::kBoth;
  if (scan_on_grid != nullptr) model.scan = std::make_shared<const Volume<float>>(*scan_on_grid);
  return model;
}

/// Width of the picture of a finding, mm: a few dozen voxels for small findings, including the surroundings
/// for large ones.
double width_of(const LintFinding& finding, const GridGeometry& grid) {
  constexpr double kVoxelsAcross = 48, kMin_mm = 12, kMax_mm = 100, kWhole_mm = 140;
  switch (finding.kind) {
    case LintKind::kIslands:
    case LintKind::kHoles:
    case LintKind::kLeakySheet:
    case LintKind::kNarrowGap:
    case LintKind::kOneVoxelSheet:
    case LintKind::kNeck:
    case LintKind::kOpenCavity:
    case LintKind::kOverlap:
      return std::clamp(kVoxelsAcross * grid.spacing_mm.mean(), kMin_mm, kMax_mm);
    default:
      return kWhole_mm;
  }
}

constexpr int kPanelPixels = 300, kPanelGap = 4;

/// Draws a ring with a dark rim around the centre of a panel.
void draw_ring(Image& picture, int left) {
  constexpr double kRadius = 24, kHalfWidth = 1.3, kRim = 1.5;
  constexpr Rgb kRing{255, 221, 64}, kDark{0, 0, 0};
  const double centre = 0.5 * (kPanelPixels - 1);
  for (int y = 0; y < kPanelPixels; ++y)
    for (int x = 0; x < kPanelPixels; ++x) {
      const double off = std::abs(std::hypot(x - centre, y - centre) - kRadius);
      if (off > kHalfWidth + kRim) continue;
      const Rgb& colour = off <= kHalfWidth ? kRing : kDark;
      std::uint8_t* pixel =
          &picture.rgb[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) +
                            static_cast<std::size_t>(left + x))];
      pixel[0] = colour.r;
      pixel[1] = colour.g;
      pixel[2] = colour.b;
    }
}

/// Axial, coronal and sagittal section through the position of a finding, side by side. The first structure
/// of the finding is orange, its other structures are blue, and the rest is grey. For a finding about the
/// whole map all structures keep their colours.
Image picture_of(const LintFinding& finding, Model model, double width_mm) {
  constexpr Rgb kFirst{240, 116, 28}, kFurther{46, 134, 240}, kOther{112, 118, 124};
  if (!finding.structures.empty())
    for (Segment& segment : model.segments) {
      const auto at = std::ranges::find(finding.structures, segment.id);
      segment.colour = at == finding.structures.end()     ? kOther
                       : at == finding.structures.begin() ? kFirst
                                                          : kFurther;
    }
  Image picture;
  picture.width = 3 * kPanelPixels + 2 * kPanelGap;
  picture.height = kPanelPixels;
  picture.rgb.assign(3 * static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height),
                     255);
  // limits the size of a page with many pictures
  SectionStyle style;
  style.grey_levels = 32;
  int left = 0;
  for (const AnatomicalPlane plane :
       {AnatomicalPlane::kAxial, AnatomicalPlane::kCoronal, AnatomicalPlane::kSagittal}) {
    const Image panel = render_section(
        model, anatomical_section(plane, *finding.position, width_mm, kPanelPixels, kPanelPixels), style);
    for (int y = 0; y < kPanelPixels; ++y)
      std::copy_n(panel.rgb.begin() + std::ptrdiff_t{3} * y * kPanelPixels, 3 * kPanelPixels,
                  picture.rgb.begin() + std::ptrdiff_t{3} * (y * picture.width + left));
    draw_ring(picture, left);
    left += kPanelPixels + kPanelGap;
  }
  return picture;
}

Result<LintPage> page_of(const LintReport& report, const LintVerbOptions& options,
                         const SceneVolumes& volumes, const Volume<float>* scan_on_grid,
                         const Progress& progress) {
  constexpr std::size_t kPicturesOfAKind = 6;
  LintPage page;
  page.program = PALPATE_VERSION " (commit " PALPATE_COMMIT ")";
  page.grade = std::string(1, report.grade);
  page.tool_radius_mm = options.tool_radius_mm;
  for (const StructureGrade& s : report.structures)
    page.structures.push_back({s.name, volumes.labels->find(s.id)->colour, std::string(1, s.grade), s.voxels,
                               s.volume_mm3, s.faults, s.warnings, s.undecided});
  const Model model = model_to_draw(volumes, scan_on_grid);
  std::array<std::size_t, 32> pictures{};
  for (std::size_t n = 0; n < report.findings.size(); ++n) {
    if (progress.stopped()) return Progress::interrupted();
    progress.report("drawing the findings",
                    static_cast<double>(n) / static_cast<double>(report.findings.size()));
    const LintFinding& finding = report.findings[n];
    const LintKindInfo& kind = lint_kind(finding.kind);
    LintPage::Finding shown{std::string(kind.title),
                            std::string(in_words(finding.severity)),
                            finding.sentence,
                            std::string(kind.effect),
                            std::string(kind.remedy),
                            position_text(finding),
                            {}};
    if (finding.position && pictures.at(static_cast<std::size_t>(finding.kind))++ < kPicturesOfAKind) {
      const double width_mm = width_of(finding, volumes.labels->geometry());
      shown.picture_png = encode_png(picture_of(finding, model, width_mm));
      char width[40];
      std::snprintf(width, sizeof width, "; pictures %.0f mm wide", width_mm);
      shown.position += width;
    }
    page.findings.push_back(std::move(shown));
  }
  for (const LintKindInfo& kind : lint_kinds())
    page.kinds.push_back({std::string(kind.title), std::string(kind.definition)});
  progress.report("drawing the findings", 1);
  return page;
}

// --- repairing ------------------------------------------------------------------------------------------

void print_repairs(std::ostream& out, const LintReport& report, const RepairedLabels& repaired) {
  out << '\n';
  if (repaired.repairs.empty()) out << "nothing to repair: the new file holds the same labels\n";
  for (const LintRepair& repair : repaired.repairs) {
    const std::string name = printable_name(repaired.labels.find(repair.structure)->name);
    if (repair.parts > 0)
      out << "repaired: " << (repair.kind == LintKind::kIslands ? "removed " : "filled ")
          << count_of(repair.parts, repair.kind == LintKind::kIslands ? "island" : "hole") << " of " << name
          << ", " << count_of(repair.voxels, "voxel") << '\n';
    else
      out << "repaired: label " << repair.structure << " is renamed to " << name << '\n';
  }
  std::array<std::size_t, 32> left{};
  for (const LintFinding& finding : report.findings)
    if (finding.severity != LintSeverity::kUndetermined && !lint_kind(finding.kind).is_repairable)
      ++left.at(static_cast<std::size_t>(finding.kind));
  for (const LintKindInfo& kind : lint_kinds())
    if (const std::size_t count = left.at(static_cast<std::size_t>(kind.kind)); count > 0)
      out << "not repaired, because it needs a decision: " << kind.title << ", " << count_of(count, "finding")
          << '\n';
}

bool retains_names(const fs::path& file) {
  std::string name = file.filename().string();
  std::ranges::transform(name, name.begin(),
                         [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  return name.ends_with(".seg.nrrd");
}

// --- the verb -------------------------------------------------------------------------------------------

int run_lint(const LintVerbOptions& options, Console& console) {
  const auto claims = claim_outputs(options);
  if (!claims) return console.fail(claims.error());
  const Progress progress = console.progress();
  auto read = read_volumes(options.source, progress, console.warn());
  if (!read) return console.fail(read.error());
  if (!read->volumes.labels)
    return console.fail({ErrorKind::kBadInput, "holds no labels to examine", options.source.target,
                         "give a label map, or a scene or data set with labels"});
  if (!read->origin_of_names.empty()) console.note(read->origin_of_names);
  SceneVolumes& volumes = read->volumes;
  const GridGeometry& grid = volumes.labels->geometry();
  std::optional<Volume<float>> moved;
  if (volumes.scan && !volumes.scan->geometry().same_grid(grid)) {
    auto resampled = resample_linear(*volumes.scan, grid, std::numeric_limits<float>::quiet_NaN());
    if (!resampled) return console.fail(resampled.error());
    moved = *std::move(resampled);
  }
  const Volume<float>* scan = moved ? &*moved : volumes.scan.get();

  LintOptions how;
  how.tool_radius_mm = options.tool_radius_mm;
  how.oriented = volumes.oriented;
  how.scan = scan;
  how.is_hard = is_hard_by_name;
  const auto report = lint(*volumes.labels, how, progress);
  if (!report) return console.fail(report.error());

  const bool words = options.json != "-";
  if (words) print_report(std::cout, *report);
  if (options.page) {
    const auto page = page_of(*report, options, volumes, scan, progress);
    if (!page) return console.fail(page.error());
    if (const auto written = write_file(*options.page, lint_html(*page)); !written)
      return console.fail(written.error());
    console.note("page: " + options.page->string());
  }
  const LabelMap names_only{{}, volumes.labels->segments};
  std::vector<LintRepair> repairs;
  if (options.fix) {
    const auto repaired = repaired_labels(*std::move(volumes.labels), 0, progress);
    if (!repaired) return console.fail(repaired.error());
    if (const auto written = write_labels(*options.fix, repaired->labels); !written)
      return console.fail(written.error());
    repairs = repaired->repairs;
    if (words) print_repairs(std::cout, *report, *repaired);
    if (!retains_names(*options.fix))
      console.warn()("only the format .seg.nrrd keeps the names and colours of the structures");
    console.note("labels: " + options.fix->string());
  }
  if (options.json) {
    const std::string text = lint_json(*report, options, names_only, repairs).dump(2) + "\n";
    if (!words)
      std::cout << text;
    else if (const auto written = write_file(*options.json, text); !written)
      return console.fail(written.error());
  }
  return report->count(LintSeverity::kFault) > 0 ? kExitLimit : kExitOk;
}

}  // namespace

void add_lint(CLI::App& app, Run& run) {
  const auto options = std::make_shared<LintVerbOptions>();
  CLI::App* verb = app.add_subcommand(
      "lint", "Check a segmentation for faults that affect touch, and repair unambiguous ones");
  add_source_options(*verb, options->source,
                     "Label map, a folder of DICOM with a segmentation, a scene file or a data set")
      ->required();
  verb->add_option("-r,--tool-radius", options->tool_radius_mm,
                   "Radius of the tool's ball in mm, used for gaps and access")
      ->check(number_between(kMinLintToolRadius_mm, kMaxLintToolRadius_mm))
      ->capture_default_str();
  verb->add_option("-j,--json", options->json,
                   "Write the findings as JSON; -: to standard output, in place of the text")
      ->type_name("FILE");
  verb->add_option("-p,--page", options->page, "Write a page with a picture of each finding (HTML)")
      ->type_name("FILE");
  verb->add_option("--fix", options->fix,
                   "Write the labels without islands and holes, and with unique names; .seg.nrrd keeps names")
      ->type_name("NEW");
  verb->footer(
      "Examples:\n"
      "  palpate lint labels.nii.gz\n"
      "  palpate lint labels.nii.gz ct.nii.gz --names dseg.tsv --page lint.html\n"
      "  palpate lint scene.toml --tool-radius 2.5\n"
      "  palpate lint knee.seg.nrrd --json - | jq .grade\n"
      "  palpate lint knee.seg.nrrd --fix repaired.seg.nrrd\n\n"
      "Exit code 3: there are faults. Warnings and undecided findings leave it 0. docs/guide/lint.md.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return run_lint(*options, console); }; });
}

}  // namespace palpate::app
