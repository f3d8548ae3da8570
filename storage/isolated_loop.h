// Loops on all threads that no caller's task group can end in the middle.
//
// A loop of TBB belongs to the task that it is called in: if that task's group is cancelled, the
// loop ends without an exception, and leaves a part of its results unmade. A caller of a public
// function may be such a task. So every loop behind a public function is isolated: only an
// exception of its own body ends it early, or a cancel flag that the body checks.
//
// The one header of `storage` that includes TBB. It is here because `extract` and `preprocess`
// share nothing else; nothing in `storage` includes it.
#pragma once

#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>
#include <tbb/task_group.h>

namespace isobrick {

// Calls f(i) for every i of [begin, end). Rethrows an exception of f.
template <typename Index, typename F>
void isolatedFor(Index begin, Index end, const F& f) {
  tbb::task_group_context isolated(tbb::task_group_context::isolated);
  tbb::parallel_for(begin, end, f, isolated);
}

// The same with a task for every i: for few of them that take long.
template <typename Index, typename F>
void isolatedForEach(Index begin, Index end, const F& f) {
  tbb::task_group_context isolated(tbb::task_group_context::isolated);
  tbb::parallel_for(begin, end, f, tbb::simple_partitioner(), isolated);
}

}  // namespace isobrick
