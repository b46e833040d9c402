"""LLVM text of the native call, as `native_call` describes it."""

from __future__ import annotations

from dataclasses import dataclass

LEADS = 4  # leading axes that a native call takes; more go the general way


@dataclass(frozen=True)
class NativeText:
    """The module, for objects with a header of so many bytes."""

    header: int

    def text(self) -> str:
        """LLVM text."""
        return TEXT.replace("HEADER", str(self.header - 8)).replace("LEADS", str(LEADS)).replace("ROOM", str(LEADS + 2))


def member(name: str, kind: str, struct: str, pointer: str, number: int, at: str = "") -> str:
    """%NAME: the member of that number of a structure; its address is %NAME.at, or `at`."""
    at = at or f"{name}.at"
    place = f"  %{at} = getelementptr %{struct}, ptr %{pointer}, i64 0, i32 {number}"
    return f"{place}\n  %{name} = load {kind}, ptr %{at}"


TEXT = f"""
; The layouts of `ArrayAxes`, `CallTable` and `ArrayFields`.
%Axes = type {{ i64, [2 x i64] }}
%Table = type {{ ptr, ptr, ptr, ptr, ptr, i64, i64, i64, i64, i64, [8 x %Axes] }}
%Array = type {{ [HEADER x i8], ptr, ptr, i32, ptr, ptr, ptr, ptr, i32 }}

declare ptr @PyTuple_GetItem(ptr, i64)
declare ptr @PyTuple_New(i64)
declare i32 @PyTuple_SetItem(ptr, i64, ptr)
declare ptr @PyLong_AsVoidPtr(ptr)
declare ptr @PyObject_Vectorcall(ptr, ptr, i64, ptr)
declare void @Py_DecRef(ptr)
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)

; True if n lengths of two shapes are the same.
define internal i1 @same(ptr %a, ptr %b, i64 %n) nounwind {{
entry:
  br label %next
next:
  %k = phi i64 [ 0, %entry ], [ %following, %look ]
  %all = icmp eq i64 %k, %n
  br i1 %all, label %yes, label %look
look:
  %pa = getelementptr i64, ptr %a, i64 %k
  %pb = getelementptr i64, ptr %b, i64 %k
  %va = load i64, ptr %pa
  %vb = load i64, ptr %pb
  %following = add i64 %k, 1
  %alike = icmp eq i64 %va, %vb
  br i1 %alike, label %next, label %no
yes:
  ret i1 true
no:
  ret i1 false
}}

; True if an object is an array of the kernel's dtype, aligned and C-contiguous, of the shape (lead, axes).
define internal i1 @fits(ptr %table, ptr %array, ptr %axes, ptr %lead, i64 %leads) nounwind {{
entry:
{member("type", "ptr", "Array", "array", 1)}
{member("wanted.type", "ptr", "Table", "table", 3)}
  %is.array = icmp eq ptr %type, %wanted.type
  br i1 %is.array, label %numbers, label %no
numbers:
{member("dtype", "ptr", "Array", "array", 7)}
{member("wanted.dtype", "ptr", "Table", "table", 4)}
  %is.number = icmp eq ptr %dtype, %wanted.dtype
{member("flags", "i32", "Array", "array", 8)}
  %both = and i32 %flags, 257 ; C-contiguous 1, aligned 256
  %is.plain = icmp eq i32 %both, 257
{member("count32", "i32", "Array", "array", 3, at="count.at")}
  %count = sext i32 %count32 to i64
  %own = load i64, ptr %axes
  %wanted.count = add i64 %leads, %own
  %is.deep = icmp eq i64 %count, %wanted.count
  %a = and i1 %is.number, %is.plain
  %b = and i1 %a, %is.deep
  br i1 %b, label %leading, label %no
leading:
{member("shape", "ptr", "Array", "array", 4)}
  %same.lead = call i1 @same(ptr %shape, ptr %lead, i64 %leads)
  br i1 %same.lead, label %trailing, label %no
trailing:
  %rest = getelementptr i64, ptr %shape, i64 %leads
  %lengths = getelementptr %Axes, ptr %axes, i64 0, i32 1
  %same.own = call i1 @same(ptr %rest, ptr %lengths, i64 %own)
  ret i1 %same.own
no:
  ret i1 false
}}

; Drops n new results.
define internal void @drop(ptr %results, i64 %n) nounwind {{
entry:
  br label %next
next:
  %k = phi i64 [ 0, %entry ], [ %following, %one ]
  %all = icmp eq i64 %k, %n
  br i1 %all, label %done, label %one
one:
  %at = getelementptr ptr, ptr %results, i64 %k
  %result = load ptr, ptr %at
  call void @Py_DecRef(ptr %result)
  %following = add i64 %k, 1
  br label %next
done:
  ret void
}}

; METH_FASTCALL | METH_KEYWORDS
define ptr @call(ptr %self, ptr %args, i64 %given, ptr %names) nounwind {{
entry:
  %shape = alloca [ROOM x i64]         ; leading axes, then those of a result
  %results = alloca [8 x ptr]
  %pointers = alloca [9 x i64]         ; number of states, inputs, outputs: what the kernel's entry takes
  %number = call ptr @PyTuple_GetItem(ptr %self, i64 0)
  %table = call ptr @PyLong_AsVoidPtr(ptr %number)
{member("general", "ptr", "Table", "table", 1)}
{member("inputs", "i64", "Table", "table", 6)}
{member("outputs", "i64", "Table", "table", 7)}
{member("most", "i64", "Table", "table", 8)}
  %axes = getelementptr %Table, ptr %table, i64 0, i32 10
{member("array.type", "ptr", "Table", "table", 3)}
  %unnamed = icmp eq ptr %names, null
  %complete = icmp eq i64 %given, %inputs
  %usual = and i1 %unnamed, %complete
  br i1 %usual, label %first, label %otherwise

; The leading axes of the first array are those of the call.
first:
  %array0 = load ptr, ptr %args
{member("type", "ptr", "Array", "array0", 1)}
  %is.array = icmp eq ptr %type, %array.type
  br i1 %is.array, label %deep, label %otherwise
deep:
{member("count32", "i32", "Array", "array0", 3, at="count.at")}
  %count = sext i32 %count32 to i64
  %own0 = load i64, ptr %axes
  %leads = sub i64 %count, %own0
  %few = icmp ule i64 %leads, LEADS    ; unsigned: too few axes are refused too
{member("shape0", "ptr", "Array", "array0", 4)}
  br i1 %few, label %lead, label %otherwise
lead:
  %j = phi i64 [ 0, %deep ], [ %j.next, %longer ]
  %states = phi i64 [ 1, %deep ], [ %states.next, %longer ]
  %lead.done = icmp eq i64 %j, %leads
  br i1 %lead.done, label %counted, label %axis
axis:
  %from = getelementptr i64, ptr %shape0, i64 %j
  %length = load i64, ptr %from
  %to = getelementptr i64, ptr %shape, i64 %j
  store i64 %length, ptr %to
  %less = sub i64 %length, 1
  %small = icmp ult i64 %less, %most   ; 1 to most
  br i1 %small, label %longer, label %otherwise
longer:
  %j.next = add i64 %j, 1
  %states.next = mul i64 %states, %length
  br label %lead
counted:
  %affordable = icmp ule i64 %states, %most
  br i1 %affordable, label %check, label %otherwise
check:
  %i = phi i64 [ 0, %counted ], [ %i.next, %checked ]
  %check.done = icmp eq i64 %i, %inputs
  br i1 %check.done, label %allocate, label %checked
checked:
  %arg.at = getelementptr ptr, ptr %args, i64 %i
  %arg = load ptr, ptr %arg.at
  %arg.axes = getelementptr %Axes, ptr %axes, i64 %i
  %fit = call i1 @fits(ptr %table, ptr %arg, ptr %arg.axes, ptr %shape, i64 %leads)
  %i.next = add i64 %i, 1
  br i1 %fit, label %check, label %otherwise

; New arrays for the results.
allocate:
{member("new", "ptr", "Table", "table", 2)}
{member("type.number64", "i64", "Table", "table", 5, at="type.number.at")}
  %type.number = trunc i64 %type.number64 to i32
  %tail = getelementptr i64, ptr %shape, i64 %leads
  store i64 %states, ptr %pointers
  br label %result
result:
  %o = phi i64 [ 0, %allocate ], [ %o.next, %allocated ]
  %results.done = icmp eq i64 %o, %outputs
  br i1 %results.done, label %again, label %one
one:
  %port = add i64 %inputs, %o
  %result.axes = getelementptr %Axes, ptr %axes, i64 %port
  %result.own = load i64, ptr %result.axes
  %lengths.at = getelementptr %Axes, ptr %result.axes, i64 0, i32 1
  %lengths = load [2 x i64], ptr %lengths.at
  store [2 x i64] %lengths, ptr %tail
  %depth = add i64 %leads, %result.own
  %depth32 = trunc i64 %depth to i32
  %made = call ptr %new(ptr %array.type, i32 %depth32, ptr %shape, i32 %type.number, ptr null, ptr null, i32 0, i32 0, ptr null)
  %result.at = getelementptr ptr, ptr %results, i64 %o
  store ptr %made, ptr %result.at
  %failed = icmp eq ptr %made, null
  br i1 %failed, label %failure, label %allocated
allocated:
{member("made.data", "ptr", "Array", "made", 2)}
  %slot = add i64 %port, 1
  %slot.at = getelementptr ptr, ptr %pointers, i64 %slot
  store ptr %made.data, ptr %slot.at
  %o.next = add i64 %o, 1
  br label %result

; Allocating may have run Python code (garbage collection), and that may have changed the arrays: look again, then only compute.
again:
  %r = phi i64 [ 0, %result ], [ %r.next, %taken ]
  %again.done = icmp eq i64 %r, %inputs
  br i1 %again.done, label %compute, label %retake
retake:
  %in.at = getelementptr ptr, ptr %args, i64 %r
  %in = load ptr, ptr %in.at
  %in.axes = getelementptr %Axes, ptr %axes, i64 %r
  %still = call i1 @fits(ptr %table, ptr %in, ptr %in.axes, ptr %shape, i64 %leads)
  br i1 %still, label %taken, label %changed
taken:
{member("in.data", "ptr", "Array", "in", 2)}
  %r.next = add i64 %r, 1
  %in.slot = getelementptr ptr, ptr %pointers, i64 %r.next
  store ptr %in.data, ptr %in.slot
  br label %again

compute:
{member("kernel", "ptr", "Table", "table", 0, at="entry.at")}
{member("hold", "i64", "Table", "table", 9)}
  %short = icmp ule i64 %states, %hold
  br i1 %short, label %held, label %released
held:
  call void %kernel(ptr %pointers)
  br label %computed
released:                              ; other threads run meanwhile
  %thread = call ptr @PyEval_SaveThread()
  call void %kernel(ptr %pointers)
  call void @PyEval_RestoreThread(ptr %thread)
  br label %computed
computed:
  %single = icmp eq i64 %outputs, 1
  br i1 %single, label %alone, label %several
alone:
  %only = load ptr, ptr %results
  ret ptr %only
several:
  %tuple = call ptr @PyTuple_New(i64 %outputs)
  %no.tuple = icmp eq ptr %tuple, null
  br i1 %no.tuple, label %failure, label %fill
fill:
  %f = phi i64 [ 0, %several ], [ %f.next, %filled ]
  %fill.done = icmp eq i64 %f, %outputs
  br i1 %fill.done, label %return, label %filled
filled:
  %part.at = getelementptr ptr, ptr %results, i64 %f
  %part = load ptr, ptr %part.at
  %status = call i32 @PyTuple_SetItem(ptr %tuple, i64 %f, ptr %part) ; takes over the reference
  %f.next = add i64 %f, 1
  br label %fill
return:
  ret ptr %tuple

failure:                               ; the error is set already
  %n.made = phi i64 [ %o, %one ], [ %outputs, %several ]
  call void @drop(ptr %results, i64 %n.made)
  ret ptr null
changed:
  call void @drop(ptr %results, i64 %outputs)
  br label %otherwise
otherwise:
  %answer = call ptr @PyObject_Vectorcall(ptr %general, ptr %args, i64 %given, ptr %names)
  ret ptr %answer
}}
"""
