"""The function that gives lanes of a loop their next attempts and tasks, in LLVM IR: see `stages.Exchange`."""

from __future__ import annotations

from armwright.kernels.loop_arguments import POINTERS
from armwright.kernels.loop_blocks import at_lane
from armwright.kernels.stages import Exchange

BLOCKS = ("over", "fresh", "task_number", "attempt_number", "task", "attempt", "result")


def exchange(name: str, w: int, stage: Exchange) -> str:
    """Text of `i64 name(blocks…, shared…, i64 rows)`: how many lanes have a task after it."""
    blocks = ", ".join(f"ptr %{block}" for block in BLOCKS)
    shared = ", ".join(f"ptr %{pointer}" for pointer in POINTERS)
    return f"""define internal i64 @"{name}"({blocks}, {shared}, i64 %rows) noinline nounwind {{
entry:
  %end.at = getelementptr i64, ptr %queue, i64 1
  %end = load i64, ptr %end.at, align 8
  br label %lane
lane:
  %l = phi i64 [ 0, %entry ], [ %l.next, %next ]
  %busy = phi i64 [ 0, %entry ], [ %busy.next, %next ]
{at_lane(over="over", number="task_number", attempt="attempt_number", fresh="fresh")}
  %ended = load double, ptr %over.at, align 8
  %number = load double, ptr %number.at, align 8
  %attempt.last = load double, ptr %attempt.at, align 8
  %works = fcmp oge double %number, 0.0
  %is.over = fcmp ogt double %ended, 0.0
  br i1 %is.over, label %look, label %keep
keep:
  %counts = zext i1 %works to i64
  %busy.kept = add i64 %busy, %counts
  br label %next
{_next_attempt(stage)}
{_next_task(w, stage)}
{_begin(w, stage)}
next:
  %busy.next = phi i64 [ %busy.kept, %keep ], [ %busy, %idle ], [ %busy.more, %row.entry ]
  %l.next = add i64 %l, 1
  %l.more = icmp ult i64 %l.next, {w}
  br i1 %l.more, label %lane, label %done.all
done.all:
  ret i64 %busy.next
}}"""


def _next_attempt(stage: Exchange) -> str:
    """An attempt that is over: another one of the same task, or the next task."""
    return f"""look:
  store double 0.0, ptr %over.at, align 8
  %attempt.after = fadd double %attempt.last, 1.0
  %may = fcmp olt double %attempt.after, {float(stage.most):e}
  %failed = fcmp olt double %ended, 2.0
  %again.failed = and i1 %failed, %may
  %again = and i1 %again.failed, %works
  br i1 %again, label %begin, label %ends"""


def _next_task(w: int, stage: Exchange) -> str:
    """Stores the result of a lane's task, and gives it the next one, if there is one."""
    return f"""ends:
  br i1 %works, label %store, label %take
store:
  %done = fptosi double %number to i64
  %done.first = mul i64 %done, {stage.result}
  %results.at = getelementptr double, ptr %results, i64 %done.first
  %result.at = getelementptr double, ptr %result, i64 %l
  br label %store.entry
{_copy("store", "result.at", w, "results.at", 1, stage.result, "take")}
take:
  %this = load i64, ptr %queue, align 8
  %some = icmp slt i64 %this, %end
  br i1 %some, label %fill, label %idle
idle:
  store double -1.0, ptr %number.at, align 8
  br label %next
fill:
  %following = add i64 %this, 1
  store i64 %following, ptr %queue, align 8
  %number.new = sitofp i64 %this to double
  store double %number.new, ptr %number.at, align 8
  %task.first = mul i64 %this, {stage.task}
  %tasks.at = getelementptr double, ptr %tasks, i64 %task.first
  %task.at = getelementptr double, ptr %task, i64 %l
  br label %fill.entry
{_copy("fill", "tasks.at", 1, "task.at", w, stage.task, "begin")}"""


def _begin(w: int, stage: Exchange) -> str:
    """Gives a lane its attempt: one that the task ranks, or the next of all in their order."""
    return f"""begin:
  %new = phi double [ 1.0, %look ], [ 2.0, %fill.entry ]
  %which = phi double [ %attempt.after, %look ], [ 0.0, %fill.entry ]
  %of = phi double [ %number, %look ], [ %number.new, %fill.entry ]
  store double %new, ptr %fresh.at, align 8
  store double %which, ptr %attempt.at, align 8
  %busy.more = add i64 %busy, 1
  %a = fptosi double %which to i64
  %ranked = icmp slt i64 %a, {stage.ranked}
  br i1 %ranked, label %rank, label %plain
rank:
  %t = fptosi double %of to i64
  %rank.first = mul i64 %t, {stage.ranked}
  %rank.index = add i64 %rank.first, %a
  %rank.at = getelementptr double, ptr %ranks, i64 %rank.index
  %rank.value = load double, ptr %rank.at, align 8
  %rank.row = fptosi double %rank.value to i64
  br label %row
plain:
  %behind = sub i64 %a, {stage.ranked}
  %plain.row = urem i64 %behind, %rows
  br label %row
row:
  %row.number = phi i64 [ %rank.row, %rank ], [ %plain.row, %plain ]
  %row.first = mul i64 %row.number, {stage.attempt}
  %attempts.at = getelementptr double, ptr %attempts, i64 %row.first
  %to.at = getelementptr double, ptr %attempt, i64 %l
  br label %row.entry
{_copy("row", "attempts.at", 1, "to.at", w, stage.attempt, "next")}"""


def _copy(label: str, source: str, source_step: int, to: str, to_step: int, entries: int, after: str) -> str:
    """A loop over entries, from one place with its step to another; entered from the block `label`."""
    return f"""{label}.entry:
  %{label}.e = phi i64 [ 0, %{label} ], [ %{label}.more, %{label}.entry ]
  %{label}.source = mul i64 %{label}.e, {source_step}
  %{label}.target = mul i64 %{label}.e, {to_step}
  %{label}.from = getelementptr double, ptr %{source}, i64 %{label}.source
  %{label}.to = getelementptr double, ptr %{to}, i64 %{label}.target
  %{label}.value = load double, ptr %{label}.from, align 8
  store double %{label}.value, ptr %{label}.to, align 8
  %{label}.more = add i64 %{label}.e, 1
  %{label}.again = icmp ult i64 %{label}.more, {entries}
  br i1 %{label}.again, label %{label}.entry, label %{after}"""
