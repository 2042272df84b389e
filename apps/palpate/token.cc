#include <cstdio>
#include <memory>

#include "palpate/link/viewer_server.h"
#include "verb.h"

namespace palpate::app {
namespace {

int make_tokens(const std::filesystem::path& file, Console& console) {
  if (!file.empty()) {
    const auto written = write_viewer_tokens(file);
    if (!written) return console.fail(written.error());
    console.note("palpate explore --token-file " + file.string() + " asks for them");
    return kExitOk;
  }
  const auto tokens = new_viewer_tokens();
  if (!tokens) return console.fail(tokens.error());
  std::fputs(tokens->c_str(), stdout);
  return kExitOk;
}

}  // namespace

void add_token(CLI::App& app, Run& run) {
  CLI::App* verb = app.add_subcommand("token", "Make tokens for viewers on other machines");
  const auto file = std::make_shared<std::filesystem::path>();
  verb->add_option("-o,--output", *file, "A new file that only you may read, instead of standard output")
      ->type_name("FILE");
  verb->footer(
      "Two lines, as `palpate explore --token-file FILE` takes them: one for who may change things, one for\n"
      "who may look on. Each has 26 characters, drawn from the kernel's random numbers (130 bits).\n"
      "\n"
      "Examples:\n"
      "  palpate token -o tokens\n"
      "  palpate explore knee-phantom --listen 0.0.0.0 --token-file tokens --tls-cert C.pem --tls-key K.pem");
  verb->callback([file, &run] { run = [file](Console& console) { return make_tokens(*file, console); }; });
}

}  // namespace palpate::app
