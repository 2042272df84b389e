#include <array>
#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/file.h"
#include "palpate/base/output.h"
#include "palpate/indentation/indentation.h"
#include "palpate/scene/named_values.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct FitVerbOptions {
  std::filesystem::path curves;
  std::optional<double> radius_mm, thickness_mm;
  std::string base, law;
  FitOptions fit;
  bool no_relaxation = false;
  std::optional<std::filesystem::path> picture, toml;
};

std::optional<SpecimenBase> base_named(const std::string& name) {
  if (name.empty()) return std::nullopt;
  return name == "thick"    ? SpecimenBase::kThick
         : name == "bonded" ? SpecimenBase::kBonded
                            : SpecimenBase::kSliding;
}

int run_fit(const FitVerbOptions& options, Console& console) {
  std::vector<OutputClaim> claims;
  for (const auto& output : {options.picture, options.toml}) {
    if (!output) continue;
    auto claimed = claim_output(*output, std::array{options.curves});
    if (!claimed) return console.fail(claimed.error());
    claims.push_back(*std::move(claimed));
  }
  if (options.picture && options.picture->extension() != ".svg")
    return console.fail({ErrorKind::kUsage, "the picture is an SVG", options.picture->string(),
                         "give it a name that ends in .svg"});
  const auto text = read_file(options.curves, kMaxCurveBytes);
  if (!text) return console.fail(text.error());
  const auto curves =
      read_indentation_curves(*text, {options.radius_mm, options.thickness_mm, base_named(options.base), ""},
                              options.curves.string());
  if (!curves) return console.fail(curves.error());
  FitOptions how = options.fit;
  how.relaxes = !options.no_relaxation;
  if (!options.law.empty()) how.law = value_of(options.law, kTissueLaws);
  const auto fit = fit_tissue(*curves, how);
  if (!fit) {
    Error error = fit.error();
    error.where = options.curves.string();
    return console.fail(error);
  }
  std::cout << fit_table(*fit) << "\n" << tissue_toml(*fit);
  if (options.picture) {
    if (const auto written = write_file(*options.picture, fit_svg(*curves, *fit)); !written)
      return console.fail(written.error());
    console.note("picture: " + options.picture->string());
  }
  if (options.toml) {
    if (const auto written = write_file(*options.toml, tissue_toml(*fit)); !written)
      return console.fail(written.error());
    console.note("tissue: " + options.toml->string());
  }
  return kExitOk;
}

}  // namespace

void add_fit(CLI::App& app, Run& run) {
  const auto options = std::make_shared<FitVerbOptions>();
  CLI::App* verb = app.add_subcommand("fit", "Fit a tissue to measured indentation curves");
  verb->add_option("curves", options->curves,
                   "Table (CSV) with the columns depth_mm and force_N, and optionally time_s, curve, "
                   "radius_mm, thickness_mm and base")
      ->required()
      ->type_name("CURVES.csv");
  verb->add_option("-r,--radius", options->radius_mm, "Radius of the spherical indenter in mm")
      ->check(number_between(0.01, 1000));
  verb->add_option("-t,--thickness", options->thickness_mm, "Thickness of the specimen in mm; default: thick")
      ->check(number_between(0.01, 1000));
  verb->add_option("-b,--base", options->base,
                   "What the specimen lies on: bonded to a plate, sliding on it, or thick: without influence")
      ->check(CLI::IsMember({"thick", "bonded", "sliding"}));
  verb->add_option("--poissons-ratio", options->fit.poissons_ratio,
                   "Poisson's ratio, which indentation does not determine")
      ->check(number_between(0.3, kMaxPoissonsRatio))
      ->capture_default_str();
  verb->add_option("--law", options->law, "Fit this law only; default: the simplest that explains the data")
      ->check(CLI::IsMember({"elastic", "neo-hookean", "exponential"}));
  verb->add_flag("--find-contact", options->fit.find_contact,
                 "Also fit the depth of first contact, because the depths do not start there");
  verb->add_flag("--no-relaxation", options->no_relaxation, "Ignore stress relaxation at constant depth");
  verb->add_option("-p,--picture", options->picture, "Draw data and fit (SVG)")->type_name("FILE");
  verb->add_option("-o,--output", options->toml, "Also write the tissue's keys to a file (TOML)")
      ->type_name("FILE");
  verb->footer(
      "Examples:\n"
      "  palpate fit curves.csv --radius 4\n"
      "  palpate fit curves.csv --radius 4 --thickness 15 --base bonded --picture fit.svg\n"
      "  palpate fit curves.csv --radius 3 --find-contact --law exponential -o liver.toml\n\n"
      "The printed keys can be pasted unchanged into a [[tissue]] of a scene. docs/guide/fit.md.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return run_fit(*options, console); }; });
}

}  // namespace palpate::app
