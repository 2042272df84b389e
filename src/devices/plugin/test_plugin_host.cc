#include "palpate/plugin/plugin_driver.h"

// the program that a test gives to PluginDriver
int main(int argc, char** argv) {
  return palpate::serve_plugin({argv + 1, argv + argc});
}
