#include "palpate/cache/cache.h"

#include <cstdio>
#include <string>

#include "palpate/base/reading.h"
#include "verb.h"

namespace palpate::app {
namespace {

std::string entries_text(const CacheContents& contents) {
  return std::to_string(contents.entries) + (contents.entries == 1 ? " entry, " : " entries, ") +
         memory_text(contents.bytes);
}

int show() {
  const std::string folder = cache_settings().folder.string();
  if (folder.empty()) {
    std::printf("nothing is kept: there is no folder for it\n");
    return kExitOk;
  }
  const CacheContents contents = cache_contents();
  std::printf("folder\t%s\n", folder.c_str());
  std::printf("kept\t%s\n", entries_text(contents).c_str());
  std::printf("at most\t%s\n", memory_text(contents.max_bytes).c_str());
  return kExitOk;
}

int empty(Console& console) {
  const auto removed = empty_cache();
  if (!removed) return console.fail(removed.error());
  std::printf("removed %s\n", entries_text(*removed).c_str());
  return kExitOk;
}

}  // namespace

void add_cache(CLI::App& app, Run& run) {
  CLI::App* cache =
      app.add_subcommand("cache", "Show or empty what was prepared before, by which scenes start fast");
  cache->require_subcommand(1);
  cache->footer(
      "What takes seconds to read and prepare is kept, so that the same scene starts at once the next time.\n"
      "It is found by the contents of the files and holds voxels, and no name: of a file, a person or a\n"
      "structure. It stands in $PALPATE_CACHE, else in $XDG_CACHE_HOME/palpate, else in ~/.cache/palpate, "
      "for\n"
      "you alone to read. PALPATE_CACHE= (empty) and --no-cache keep nothing. It takes at most 4 GB, or "
      "what\n"
      "PALPATE_CACHE_LIMIT says (800M), and a tenth of what is free on the disk; what was used longest ago\n"
      "goes first. It may be emptied at any time.\n"
      "\n"
      "Examples:\n"
      "  palpate cache show\n"
      "  palpate cache empty\n"
      "  PALPATE_CACHE_LIMIT=1G palpate explore knee-phantom");
  cache->add_subcommand("show", "Say where it is and what it takes")->callback([&run] {
    run = [](Console&) { return show(); };
  });
  cache->add_subcommand("empty", "Remove all of it")->callback([&run] {
    run = [](Console& console) { return empty(console); };
  });
}

}  // namespace palpate::app
