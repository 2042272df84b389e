// Two tools on one knee: they come down from above, and each feels its own contact. A console program for mono and .NET;
// in Unity the loop's body stands in a thread of the haptic devices, and the poses come from them.
using System;
using Palpate;

static class TwoHands
{
    static int Main()
    {
        try
        {
            using (var model = Model.Load("knee-phantom:spacing=3"))
            {
                var options = SessionOptions.Defaults();
                options.Devices = 2;
                using (var session = new Session(model, options))
                {
                    var poses = session.NewPoses();
                    var most = new double[2];
                    for (int tick = 0; tick < 2000; ++tick)
                    {
                        double height = 80 - 0.03 * tick;
                        poses[0].TipMm = new Vector(-15, 0, height);
                        poses[1].TipMm = new Vector(15, 0, height);
                        var wrenches = session.Tick(poses, 1e-3);
                        for (int n = 0; n < 2; ++n) most[n] = Math.Max(most[n], wrenches[n].ForceN.Length);
                    }
                    for (int n = 0; n < 2; ++n)
                        Console.WriteLine("hand {0}: {1:F2} N at most, structure {2}", n, most[n], session.Last(n).Label);
                    Console.WriteLine("hash {0:x16}", session.Hash);
                }
            }
            return 0;
        }
        catch (PalpateException error)
        {
            Console.Error.WriteLine(error.Message);
            return 1;
        }
    }
}
