#include <sys/resource.h>

#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

#include "palpate/cache/cache.h"
#include "palpate/loading/loading.h"

/// A single start, for bench/start.py: loads what the command line names until it is ready for the proxy,
/// with the cache of the environment. Prints the model's hash, that of its surfaces, and the peak memory in
/// MiB.
int main(int argc, char** argv) {
  using namespace palpate;
  if (argc != 2) {
    std::fprintf(stderr, "start_bench: name a data set, a scene file or a volume\n");
    return 2;
  }
  auto cache = cache_settings_of_environment();
  if (!cache) {
    std::fprintf(stderr, "start_bench: error: %s\n", cache.error().message().c_str());
    return 2;
  }
  cache->warn = [](const std::string& text) {
    std::fprintf(stderr, "start_bench: warning: %s\n", text.c_str());
  };
  set_cache(*std::move(cache));
  const auto loaded = load_scene_or_data_set({argv[1]});
  const ForceMethod method = ForceMethod::kProxy;
  const auto ready = loaded ? prepared_with_cache(loaded->model, {&method, 1}) : loaded.error();
  if (!ready) {
    std::fprintf(stderr, "start_bench: error: %s\n", ready.error().message().c_str());
    return 1;
  }
  std::uint64_t surfaces = 0;
  for (const ContactSurface& surface : (*ready)->surfaces)
    if (surface.surface) surfaces = surfaces * 31 + surface.surface->content_hash();
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf("%016llx %016llx %ld\n", static_cast<unsigned long long>((*ready)->content_hash),
              static_cast<unsigned long long>(surfaces), usage.ru_maxrss >> 10);
  // exits without destructors, because a session does not end here
  std::fflush(stdout);
  std::_Exit(0);
}
