#include "palpate/cache/cache.h"

#include <cstdio>
#include <string>

#include "palpate/base/reading.h"
#include "verb.h"

namespace palpate::app {
namespace {

std::string entries_text(const CacheContents& contents) {
  return std::to_string(contents.entries) + (contents.entries == 1 ? " entry, " : " entries, ") +
         memory_size_text(contents.bytes);
}

int show() {
  const std::string folder = cache_settings().folder.string();
  if (folder.empty()) {
    std::printf("the cache is off: it has no folder\n");
    return kExitOk;
  }
  const CacheContents contents = cache_contents();
  std::printf("folder\t%s\n", folder.c_str());
  std::printf("kept\t%s\n", entries_text(contents).c_str());
  std::printf("at most\t%s\n", memory_size_text(contents.max_bytes).c_str());
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
  CLI::App* cache = app.add_subcommand("cache", "Show or empty the cache of prepared scenes");
  cache->require_subcommand(1);
  cache->footer(
      "Results that take seconds to read and prepare are cached, so that the same scene starts at once the\n"
      "next time. Entries are keyed by the contents of the files. They hold voxels, but no names of files,\n"
      "persons or structures. The cache is in $PALPATE_CACHE, else in $XDG_CACHE_HOME/palpate, else in\n"
      "~/.cache/palpate; only you can read it. PALPATE_CACHE= (empty) and --no-cache turn it off. Its size "
      "is\n"
      "limited to 4 GB or PALPATE_CACHE_LIMIT (such as 800M), and to a tenth of the free disk space; the\n"
      "least recently used entries are removed first. It may be emptied at any time.\n\n"
      "Examples:\n"
      "  palpate cache show\n"
      "  palpate cache empty\n"
      "  PALPATE_CACHE_LIMIT=1G palpate explore knee-phantom");
  cache->add_subcommand("show", "Show the folder, size and limit of the cache")->callback([&run] {
    run = [](Console&) { return show(); };
  });
  cache->add_subcommand("empty", "Remove all entries")->callback([&run] {
    run = [](Console& console) { return empty(console); };
  });
}

}  // namespace palpate::app
