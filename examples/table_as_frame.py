# A table of lines as a DataFrame: the largest, and what each kind of line carries.
import microvib as mv

table = mv.find_lines("state-1", start="steady")
frame = table.to_dataframe()

largest = frame.nlargest(5, "amplitude_n_m")
print(largest[["kind", "frequency_hz", "amplitude_n_m"]].to_string())
print(
    (frame.groupby("kind").amplitude_n_m.apply(lambda amplitude: (amplitude**2 / 2).sum() ** 0.5) * 1e3)
    .round(3)
    .to_string()
)
print(table.to_xarray().amplitude_n_m.attrs)
