"""LLVM IR of a built-in function: `call`, which reads Python's and NumPy's objects where their public C structures have them.

Whatever is not the plain case goes to a Python function, by the block "elsewhere".
"""

from ..trace.layout import Looped
from ..trace.program import Program
from .code import Code

# Offsets in PyObject and PyArrayObject_fields (numpy/ndarraytypes.h), 64 bit.
TYPE, DATA, ND, DIMS, DESCR, FLAGS = 8, 16, 24, 32, 56, 64
PLAIN, WRITEABLE = 0x0001 | 0x0100, 0x0400  # C-contiguous, aligned
SIZE, ITEMS = 16, 24  # in PyTupleObject
NPY_DOUBLE = 12
SMALL = 50_000  # instructions times states up to which a batch is computed without letting other threads run

# What the code needs of this process, in the order of its table.
TABLE = (
    *("ndarray", "float64", "none", "one", "out", "threads"),  # objects, by their address
    *("array_new", "vectorcall", "incref", "decref", "save_thread", "restore_thread"),
    *("scalar_run", "vector_run"),  # null until there is such code
)


Place = tuple[str, str]  # where an array's numbers are, and how many lie between its rows: 0 where one row serves all
Shape = tuple[str, str]  # an array's numbers of dimensions and of rows


class _Call(Code):
    """A function that reads Python's objects."""

    def field(self, pointer: str, offset: int, kind: str) -> str:
        return self.value(f"load {kind}, ptr {self.value(f'getelementptr i8, ptr {pointer}, i64 {offset}')}")

    def after(self, pointer: str, count: str) -> str:
        """The address behind so many doubles."""
        return self.value(f"getelementptr double, ptr {pointer}, i64 {count}")

    def check(self, condition: str, otherwise: str = "elsewhere") -> None:
        """Go on where an instruction finds so; elsewhere the Python function takes over."""
        self.require(self.value(condition), otherwise)

    def plain(self, array: str, flags: int) -> None:
        """It is an array of float64 with these flags, and of one or two dimensions."""
        self.check(f"icmp eq ptr {self.field(array, TYPE, 'ptr')}, %ndarray")
        self.check(f"icmp eq ptr {self.field(array, DESCR, 'ptr')}, %float64")
        found = self.value(f"and i32 {self.field(array, FLAGS, 'i32')}, {flags}")
        self.check(f"icmp eq i32 {found}, {flags}")
        nd = self.field(array, ND, "i32")
        self.check(f"icmp uge i32 {nd}, 1")
        self.check(f"icmp ule i32 {nd}, 2")

    def extent(self, array: str, width: int, first: Shape) -> Shape:
        """Its numbers of dimensions and of rows, which are those of the first array, if there is one; its rows are of this width."""
        nd, dims = self.field(array, ND, "i32"), self.field(array, DIMS, "ptr")
        last = self.value(f"sub i32 {nd}, 1")
        columns = self.value(f"load i64, ptr {self.value(f'getelementptr i64, ptr {dims}, i32 {last}')}")
        self.check(f"icmp eq i64 {columns}, {width}")
        flat = self.value(f"icmp eq i32 {nd}, 1")
        rows = self.value(f"select i1 {flat}, i64 1, i64 {self.value(f'load i64, ptr {dims}')}")
        if all(first):
            self.check(f"icmp eq i32 {nd}, {first[0]}")
            self.check(f"icmp eq i64 {rows}, {first[1]}")
        return nd, rows


def module(program: Program | Looped, arrays: tuple[str, ...], optional: int, lanes: int, most: int) -> str:
    """IR text of the table, and of `ptr @call(ptr self, ptr arguments, i64 count, ptr keywords)`.

    arrays: the inputs that are arguments, the last `optional` of them optional. lanes: states from which vector code serves.
    most: instructions times states up to which one thread has enough.
    """
    (values,) = program.outputs.values()
    length, width = max(1, program.length), len(values)
    code = _Call()
    code.allocations.append("  %shape = alloca [2 x i64]")
    for k, name in enumerate(TABLE):
        code.add(f"%{name}.at = getelementptr ptr, ptr @table, i64 {k}")
        code.add(f"%{name} = load ptr, ptr %{name}.at")
    code.check(f"icmp sle i64 %count, {len(arrays)}")
    code.check(f"icmp sge i64 %count, {len(arrays) - optional}")
    out, threads = _keywords(code)
    places, shape = _arguments(code, [program.inputs[name] for name in arrays], optional)
    run = _code_to_run(code, shape, threads, lanes, most // length + 1)
    result = _result(code, out, width, shape, places)
    by_name = dict(zip(arrays, places, strict=True))
    _evaluated(code, run, [by_name.get(name, ("@zeros", "0")) for name in program.inputs], result, shape, length)
    code.block("error")
    code.leave("ptr", "null")
    code.block("discard")
    code.add(f"call void %decref(ptr {result})")
    code.add("br label %elsewhere")
    code.block("elsewhere")
    code.leave("ptr", code.value("call ptr %vectorcall(ptr %self, ptr %arguments, i64 %count, ptr %keywords)"))
    zeros = max(program.inputs.values(), default=1)
    lines = [f"@table = global [{len(TABLE)} x ptr] zeroinitializer", f"@zeros = internal global [{zeros} x double] zeroinitializer"]
    lines += code.function("define ptr @call(ptr %self, ptr %arguments, i64 %count, ptr %keywords)")
    return "\n".join(lines) + "\n"


def _arguments(code: _Call, sizes: list[int], optional: int) -> tuple[list[Place], Shape]:
    """Each argument: a plain float64 array of one dimension, or of two and with as many rows as the first; zeros for what is not given."""
    places: list[Place] = []
    shape = ("", "")
    for k, size in enumerate(sizes):
        if k < len(sizes) - optional:
            place, shape = _argument(code, k, size, shape)
            places.append((place, str(size)))
            continue
        with code.branch(code.value(f"icmp sgt i64 %count, {k}")) as merged:
            place, _ = _argument(code, k, size, shape)
        places.append((merged("ptr", place, "@zeros"), merged("i64", str(size), "0")))
    code.check(f"icmp sgt i64 {shape[1]}, 0")
    return places, shape


def _code_to_run(code: _Call, shape: Shape, threads: str, lanes: int, rows_alone: int) -> str:
    """Few states: scalar code. More: vector code, once it is there."""
    _, rows = shape
    # Work for several threads is the fallback's, unless it may have one only.
    alone = code.value(f"icmp slt i64 {rows}, {rows_alone}")
    code.require(code.value(f"or i1 {alone}, {code.value(f'icmp eq ptr {threads}, %one')}"), "elsewhere")
    few = code.value(f"icmp slt i64 {rows}, {lanes}")
    run = code.value(f"select i1 {few}, ptr %scalar_run, ptr %vector_run")
    code.check(f"icmp ne ptr {run}, null")
    return run


def _result(code: _Call, out: str, width: int, shape: Shape, places: list[Place]) -> str:
    """The array of the result, counted once more: a given one apart from the arguments, or a new one."""
    nd, rows = shape
    with code.branch(code.value(f"icmp ne ptr {out}, null")):
        code.plain(out, PLAIN | WRITEABLE)
        code.extent(out, width, shape)
        start = code.field(out, DATA, "ptr")
        end = code.after(start, code.value(f"mul i64 {rows}, {width}"))
        for place, stride in places:
            stop = code.after(place, code.value(f"mul i64 {rows}, {stride}"))
            before, behind = code.value(f"icmp ule ptr {end}, {place}"), code.value(f"icmp ule ptr {stop}, {start}")
            code.require(code.value(f"or i1 {before}, {behind}"), "elsewhere")
        code.add(f"call void %incref(ptr {out})")
    flat = code.value(f"icmp eq i32 {nd}, 1")
    code.add(f"store i64 {code.value(f'select i1 {flat}, i64 {width}, i64 {rows}')}, ptr %shape")
    code.add(f"store i64 {width}, ptr {code.value('getelementptr i64, ptr %shape, i64 1')}")
    with code.branch(code.value(f"icmp eq ptr {out}, null")) as merged:
        arguments = f"ptr %ndarray, i32 {nd}, ptr %shape, i32 {NPY_DOUBLE}, ptr null, ptr null, i32 0, i32 0, ptr null"
        new = code.value(f"call ptr %array_new({arguments})")
        code.check(f"icmp ne ptr {new}, null", otherwise="error")
    return merged("ptr", new, out)


def _evaluated(code: _Call, run: str, inputs: list[Place], result: str, shape: Shape, length: int) -> None:
    """Fill the result and return it. Long work lets other Python threads run."""
    _, rows = shape
    passed = ", ".join(f"ptr {place}, i64 {stride}" for place, stride in inputs)
    arguments = f"{passed}, ptr {code.field(result, DATA, 'ptr')}, i64 {rows}"
    with code.branch(code.value(f"icmp sgt i64 {rows}, {SMALL // length}")) as merged:
        state = code.value("call ptr %save_thread()")
    state = merged("ptr", state, "null")
    bad = code.value(f"call i64 {run}({arguments})")
    with code.branch(code.value(f"icmp ne ptr {state}, null")):
        code.add(f"call void %restore_thread(ptr {state})")
    code.check(f"icmp slt i64 {bad}, 0", otherwise="discard")
    code.leave("ptr", result)


def _argument(code: _Call, k: int, size: int, first: Shape) -> tuple[str, Shape]:
    """Where the numbers of argument k are, and its shape, which is the first one's."""
    array = code.value(f"load ptr, ptr {code.value(f'getelementptr ptr, ptr %arguments, i64 {k}')}")
    code.plain(array, PLAIN)
    extent = code.extent(array, size, first)
    return code.field(array, DATA, "ptr"), extent


def _keywords(code: _Call) -> tuple[str, str]:
    """out and threads, null where they are not given; nothing else may be."""
    found = {"out": "null", "threads": "null"}
    with code.branch(code.value("icmp ne ptr %keywords, null")) as merged:
        names = code.field("%keywords", SIZE, "i64")
        code.check(f"icmp sle i64 {names}, {len(found)}")
        for k in range(len(found)):
            with code.branch(code.value(f"icmp sgt i64 {names}, {k}")) as further:
                name = code.field("%keywords", ITEMS + 8 * k, "ptr")
                at = code.value(f"getelementptr ptr, ptr %arguments, i64 {code.value(f'add i64 %count, {k}')}")
                value = code.value(f"load ptr, ptr {at}")
                matches = {key: code.value(f"icmp eq ptr {name}, %{key}") for key in found}
                code.require(code.value(f"or i1 {matches['out']}, {matches['threads']}"), "elsewhere")
                chosen = {key: code.value(f"select i1 {matches[key]}, ptr {value}, ptr {found[key]}") for key in found}
            found = {key: further("ptr", chosen[key], found[key]) for key in found}
        # None is as good as nothing.
        found = {key: code.value(f"select i1 {code.value(f'icmp eq ptr {x}, %none')}, ptr null, ptr {x}") for key, x in found.items()}
    out, threads = (merged("ptr", found[key], "null") for key in ("out", "threads"))
    nothing, one = code.value(f"icmp eq ptr {threads}, null"), code.value(f"icmp eq ptr {threads}, %one")
    code.require(code.value(f"or i1 {nothing}, {one}"), "elsewhere")
    return out, threads
