// Errors of the library as those of Python.
#pragma once

namespace isobrick::python {

// From now on Error and Cancelled that leave a function of the calling module are `isobrick.Error`
// and `isobrick.Cancelled`, with `path`, `offset`, `level` and `brick`.
void translateErrors();

}  // namespace isobrick::python
