#include "palpate/catalog/catalog.h"

#include <cstdio>
#include <iostream>

#include "palpate/base/file.h"
#include "palpate/base/output.h"
#include "palpate/json/json.h"
#include "palpate/loading/loading.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/rendering/volume_picture.h"
#include "palpate/report/data_page.h"
#include "palpate_version.h"
#include "verb.h"

namespace palpate::app {
namespace {

constexpr int kPicture_px = 320;

struct DataOptions {
  bool json = false;
  std::filesystem::path page;
  std::string name;
  FetchOptions fetch;
};

const char* source_word(DataSource source) {
  switch (source) {
    case DataSource::kGenerated:
      return "generated";
    case DataSource::kFetched:
      return "fetched";
    case DataSource::kPackage:
      return "package";
  }
  return "";
}

// files of a data set, one per line, readable and suitable for `cut -f2`
void print_files(const LocalData& data) {
  std::cout << "labels\t" << data.labels.string() << '\n';
  if (data.scan) std::cout << "scan\t" << data.scan->string() << '\n';
  if (data.names) std::cout << "names\t" << data.names->string() << '\n';
}

std::string state(const CatalogEntry& entry, const Result<LocalData>& data) {
  if (data) return "here, in " + data->labels.parent_path().string();
  if (data.error().kind != ErrorKind::kUnavailable) return "unusable: " + data.error().message();
  if (entry.source == DataSource::kGenerated)
    return "generated in memory on demand; parameters: palpate data keys";
  return "not here: " + data.error().remedy;
}

void print_table() {
  for (const auto& entry : catalog()) {
    std::printf("%-13s %s\n", entry.name.c_str(), entry.summary.c_str());
    std::printf("%-13s %s\n", "", state(entry, locate(entry.name)).c_str());
    std::printf("%-13s licence: %s\n", "", entry.licence.c_str());
  }
}

void print_json() {
  auto sets = Json::array();
  for (const auto& entry : catalog()) {
    const auto data = locate(entry.name);
    Json set{{"name", entry.name},       {"summary", entry.summary},
             {"licence", entry.licence}, {"source", source_word(entry.source)},
             {"home", entry.home},       {"here", data.ok()}};
    if (data) {
      set["labels"] = data->labels.string();
      if (data->scan) set["scan"] = data->scan->string();
      if (data->names) set["names"] = data->names->string();
    } else {
      set["problem"] = data.error().message();
    }
    sets.push_back(std::move(set));
  }
  // a path may contain any bytes; JSON is UTF-8
  std::cout << sets.dump(2) << '\n';
}

Result<std::vector<std::uint8_t>> picture_of(const std::string& name, Console& console) {
  // the picture does not need touchable tissue
  const auto loaded = load_scene_or_data_set({name}, console.progress());
  if (!loaded) return loaded.error();
  const Model& model = *loaded->model;
  if (model.labels == nullptr || model.segments.empty()) return std::vector<std::uint8_t>();
  return volume_thumbnail(model, kPicture_px, console.progress());
}

/// Writes a page with a picture of each data set that is available or can be generated. A data set that
/// cannot be drawn does not stop the others.
int write_data_page(const DataOptions& options, Console& console) {
  const auto claimed = claim_output(options.page, {});
  if (!claimed) return console.fail(claimed.error());
  DataPage page;
  page.program = PALPATE_VERSION " (commit " PALPATE_COMMIT ", " PALPATE_BUILD_TYPE ")";
  for (const auto& entry : catalog()) {
    const auto data = locate(entry.name);
    // without a path of this machine, because the page may be passed on
    DataPage::Set set{entry.name, entry.summary, entry.licence, data ? "here" : state(entry, data), "", {}};
    if (data || entry.source == DataSource::kGenerated) {
      auto picture = picture_of(entry.name, console);
      if (!picture && picture.error().kind == ErrorKind::kInterrupted) return console.fail(picture.error());
      if (picture)
        set.picture_png = *std::move(picture);
      else
        set.fault = picture.error().message();
    }
    page.sets.push_back(std::move(set));
  }
  const auto written = write_file(options.page, data_html(page));
  if (!written) return console.fail(written.error());
  console.note("page: " + options.page.string());
  return kExitOk;
}

int list(const DataOptions& options, Console& console) {
  if (!options.page.empty()) return write_data_page(options, console);
  options.json ? print_json() : print_table();
  return kExitOk;
}

int where(const DataOptions& options, Console& console) {
  const auto data = locate(options.name);
  if (!data) return console.fail(data.error());
  print_files(*data);
  return kExitOk;
}

int fetch_set(const DataOptions& options, Console& console) {
  const auto entry = find_entry(options.name);
  if (!entry) return console.fail(entry.error());
  console.note((*entry)->name + ": " + (*entry)->summary + "\nlicence: " + (*entry)->licence);
  const auto before = locate(options.name);
  bool warned = false;
  const Warn warn = [&warned, show = console.warn()](const std::string& message) {
    warned = true;
    show(message);
  };
  const auto data = fetch(options.name, options.fetch, console.progress(), warn);
  if (!data) return console.fail(data.error());
  const bool same = before && before->labels == data->labels && (*entry)->source != DataSource::kGenerated;
  if (same && !warned) console.note("already here; nothing to fetch");
  if (!data->scan && !warned)
    console.note("without its image; `palpate data fetch " + (*entry)->name +
                 " -o FOLDER` tries to fetch it");
  print_files(*data);
  return kExitOk;
}

void add_list(CLI::App& data, const std::shared_ptr<DataOptions>& options, Run& run) {
  CLI::App* verb = data.add_subcommand("list", "List the data sets, their licences and where they are");
  CLI::Option* json = verb->add_flag("-j,--json", options->json, "Print JSON instead of text");
  verb->add_option("--page", options->page, "Write an HTML page with a picture of each data set instead")
      ->type_name("FILE")
      ->excludes(json);
  verb->footer("Examples:\n  palpate data list\n  palpate data list --page data.html");
  verb->callback([options, &run] { run = [options](Console& c) { return list(*options, c); }; });
}

void add_fetch(CLI::App& data, const std::shared_ptr<DataOptions>& options, Run& run) {
  CLI::App* verb =
      data.add_subcommand("fetch", "Fetch or generate a data set; an interrupted download is resumed");
  verb->add_option("NAME", options->name, "Name of the data set (palpate data list)")->required();
  verb->add_option("-o,--output", options->fetch.into,
                   "Folder for its files; default: the user's data folder")
      ->type_name("FOLDER");
  verb->add_option("-m,--mirror", options->fetch.mirror,
                   "Fetch from this address (http or https) instead of the original one")
      ->type_name("URL");
  verb->add_option("--voxel", options->fetch.voxel_mm,
                   "Voxel size in mm of a phantom without parameters; default: 0.6, or 1 for the skull and "
                   "the palpation phantoms")
      ->type_name("MM")
      ->check(number_between(0.2, 3));
  verb->footer(
      "Examples:\n"
      "  palpate data fetch knee-atlas                  into the user's data folder\n"
      "  palpate data fetch knee-atlas -o knee          a separate copy\n"
      "  palpate data fetch knee-phantom --voxel 0.4 -o phantom\n"
      "  palpate data fetch knee-phantom:side=right,lesion=6 -o phantom");
  verb->callback([options, &run] { run = [options](Console& c) { return fetch_set(*options, c); }; });
}

void add_data_keys(CLI::App& data, Run& run) {
  CLI::App* verb = data.add_subcommand("keys", "Print the parameters of the phantoms as Markdown tables");
  verb->footer(
      "Parameters follow the name of a phantom wherever a data set is named.\n\n"
      "Examples:\n"
      "  palpate simulate knee-phantom:side=right,seed=3,lesion=6 --report run.html\n"
      "  palpate section skull-phantom:temporal=2,brain=no -o skull.png");
  verb->callback([&run] { run = [](Console&) { return print_result(phantom_keys()); }; });
}

void add_where(CLI::App& data, const std::shared_ptr<DataOptions>& options, Run& run) {
  CLI::App* verb =
      data.add_subcommand("where", "Print the files of a data set, one per line: kind, tab, path");
  verb->add_option("NAME", options->name, "Name of the data set (palpate data list)")->required();
  verb->footer(
      "Examples:\n"
      "  palpate data where knee-atlas\n"
      "  palpate info \"$(palpate data where head | grep ^labels | cut -f2)\"");
  verb->callback([options, &run] { run = [options](Console& c) { return where(*options, c); }; });
}

}  // namespace

void add_data(CLI::App& app, Run& run) {
  CLI::App* data = app.add_subcommand("data", "List, fetch and locate public data sets");
  data->require_subcommand(1);
  data->footer(
      "Data sets are searched for in the folders of PALPATE_DATA (separated by colons), in the user's data\n"
      "folder ($XDG_DATA_HOME/palpate or ~/.local/share/palpate), and in the folders of installed "
      "packages.\n\n"
      "Examples:\n"
      "  palpate data list\n"
      "  palpate data fetch knee-atlas\n"
      "  palpate data where knee-atlas\n"
      "  palpate data keys                              parameters of phantoms: knee-phantom:side=right");
  const auto options = std::make_shared<DataOptions>();
  add_list(*data, options, run);
  add_fetch(*data, options, run);
  add_data_keys(*data, run);
  add_where(*data, options, run);
}

}  // namespace palpate::app
