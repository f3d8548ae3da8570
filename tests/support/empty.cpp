// The precompiled header of the tests belongs to a library, which needs a source.
