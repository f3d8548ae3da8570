// isobrick-sources.so: what tools/main.cpp loads.
#include "isobrick/preprocess/sources/indexed_source.h"

extern "C" const isobrick::SourceOpener* isobrickSourceOpener() {
  static const isobrick::SourceOpener opener = isobrick::volumeSourceOpener();
  return &opener;
}
